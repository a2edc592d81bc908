// Rays, their limits, and how a ray leaves a surface. The only home of rounding bounds.

#define EPSILON 0x1p-24f // half the distance from 1 to the next float: the largest relative error of one rounding

// (1 +- EPSILON)^3 lies within 1 +- 4 EPSILON: one subtraction, one reciprocal, one product (Higham, "Accuracy and Stability of
// Numerical Algorithms", 2002, section 3.1: gamma(3) < 4 EPSILON). The product with the factor itself rounds once more: 5, and
// the factors are exact floats with 6 to have one to spare.
#define WIDEN_UP (1.0f + 6.0f * EPSILON)
#define WIDEN_DOWN (1.0f - 6.0f * EPSILON)

// A ray ready for traversal. The direction is scaled by a power of two to a largest component in [1, 2), which is exact and
// makes every later step independent of the caller's units; t here is the caller's t / t_scale.
typedef struct {
    float3 origin;
    float3 direction;
    float3 inv_direction; // +infinity for a zero component; NaN where the reciprocal overflows: no plane of that axis is decisive
    float t_near, t_far;  // closed interval; t_far is finite or -infinity
    float t_scale;
    uint skip;            // triangle that is never hit: the one that the ray starts on
} Ray;

float reciprocal_or_nan(float x) {
    const float r = 1.0f / x;
    return x != 0.0f && !is_finite(r) ? NAN : r;
}

// A ray with NaN or infinite parts or without direction gets an empty interval: it misses everything.
Ray make_ray(float3 origin, float3 direction, float t_near, float t_far, uint skip) {
    Ray ray;
    ray.skip = skip;
    ray.origin = origin;
    ray.t_scale = 1.0f;
    const bool sound = scale_to_unit(&direction, &ray.t_scale) && is_finite3(origin) && t_near <= t_far;
    direction += 0.0f; // -0 becomes +0, so that a zero component has one reciprocal
    ray.direction = direction;
    ray.inv_direction =
        (float3)(reciprocal_or_nan(direction.x), reciprocal_or_nan(direction.y), reciprocal_or_nan(direction.z));
    ray.t_near = sound ? t_near / ray.t_scale : INFINITY;
    ray.t_far = sound ? min_or(t_far / ray.t_scale, FLT_MAX) : -INFINITY;
    return ray;
}

// t rounded away from and towards -infinity by more than its error. Products, so that infinity stays infinity and NaN NaN.
float widen_up(float t) { return t * (t > 0.0f ? WIDEN_UP : WIDEN_DOWN); }
float widen_down(float t) { return t * (t > 0.0f ? WIDEN_DOWN : WIDEN_UP); }

// Narrows *t_near..*t_far to one slab of a box. The comparisons are false for NaN, which arises when the ray runs in a face of
// the box (0 * infinity) or when the reciprocal overflowed: the slab then does not narrow the interval.
void clip_to_slab(float low, float high, float origin, float inv_direction, float* t_near, float* t_far) {
    const float t_low = (low - origin) * inv_direction;
    const float t_high = (high - origin) * inv_direction;
    const bool ascending = inv_direction >= 0.0f;
    const float t_enter = widen_down(ascending ? t_low : t_high);
    const float t_leave = widen_up(ascending ? t_high : t_low);
    if (t_enter > *t_near) *t_near = t_enter;
    if (t_leave < *t_far) *t_far = t_leave;
}

// The part of the ray inside the box, a little more rather than less. False when there is none.
// Kay and Kajiya, "Ray Tracing Complex Scenes", SIGGRAPH 1986; conservative as in Ize, "Robust BVH Ray Traversal", JCGT 2013.
bool clip_to_box(const Ray* ray, float3 low, float3 high, float* t_near, float* t_far) {
    *t_near = ray->t_near;
    *t_far = ray->t_far;
    clip_to_slab(low.x, high.x, ray->origin.x, ray->inv_direction.x, t_near, t_far);
    clip_to_slab(low.y, high.y, ray->origin.y, ray->inv_direction.y, t_near, t_far);
    clip_to_slab(low.z, high.z, ray->origin.z, ray->inv_direction.z, t_near, t_far);
    return *t_near <= *t_far;
}

// Whether a hit at t (in the ray's own units) on `primitive` is inside the limits and nearer than *hit; of two hits at the
// same t the lower number wins, so that the answer does not depend on the order of the tests.
bool is_nearer(const Ray* ray, const Hit* hit, float t, uint primitive) {
    return t >= ray->t_near && t <= ray->t_far && (t < hit->t || (t == hit->t && primitive < hit->primitive));
}

// The point of triangle p0 p1 p2 with weights u and v of vertices 1 and 2.
float3 point_on_triangle(float3 p0, float3 p1, float3 p2, float u, float v) {
    return fma3(p0, (1.0f - u) - v, fma3(p1, u, p2 * v));
}

// A bound of the distance between that computed point and the triangle's plane, on each axis. Each product and sum rounds
// (3 for the longest chain) and the three weights sum to 1 only within 2 roundings, each relative to the terms' magnitudes:
// gamma(5) sum |weight_i p_i|, and the sum is at most the largest coordinate because the weights are not negative.
float point_error(float3 p0, float3 p1, float3 p2) {
    const float largest = max_or(max_component(abs3(p0)), max_or(max_component(abs3(p1)), max_component(abs3(p2))));
    return 6.0f * EPSILON * largest;
}
