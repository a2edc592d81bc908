// Rays, their limits, and how a ray leaves a surface. The only home of rounding bounds.

#define EPSILON 0x1p-24f // half the distance from 1 to the next float: the largest relative error of one rounding

// The t of a plane: a difference from the origin's two parts, off by 3 EPSILON (see from_origin), one reciprocal and one product:
// within gamma(5) < 6 EPSILON (Higham, "Accuracy and Stability of Numerical Algorithms", 2002, section 3.1). The product with the
// factor itself rounds once more: 7, and the factors are exact floats with 8 to have one to spare.
#define WIDEN_UP (1.0f + 8.0f * EPSILON)
#define WIDEN_DOWN (1.0f - 8.0f * EPSILON)

// A ray ready for traversal. The direction is scaled by a power of two to a largest component in [1, 2), which is exact and
// makes every later step independent of the caller's units; t here is the caller's t / t_scale.
typedef struct {
    float3 origin;
    float3 origin_low;    // the ray starts at origin + origin_low exactly; not larger than the rounding of origin
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

// Where p lies as seen from the start of the ray. The first difference is exact where the second part matters: where both are of
// like size (Sterbenz). So the result is off by at most 3 EPSILON of itself, and by 2 EPSILON of the coordinates' difference.
float3 from_origin(const Ray* ray, float3 p) { return (p - ray->origin) - ray->origin_low; }

// A ray that starts at `origin`. One with NaN or infinite parts or without direction gets an empty interval: it misses everything.
Ray make_ray(float3 origin, float3 direction, float t_near, float t_far, uint skip) {
    Ray ray;
    ray.skip = skip;
    ray.origin = origin;
    ray.origin_low = (float3)(0.0f);
    ray.t_scale = 1.0f;
    const bool sound = scale_to_unit(&direction, &ray.t_scale) && is_finite3(origin) && t_near <= t_far;
    // A zero component has one reciprocal.
    direction = (float3)(positive_zero(direction.x), positive_zero(direction.y), positive_zero(direction.z));
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

// Narrows *t_near..*t_far to the time between two planes, a little more rather than less. The comparisons are false for NaN.
void narrow_interval(float t_low, float t_high, float inv_direction, float* t_near, float* t_far) {
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
    // A NaN arises when the ray runs in a face of the box (0 * infinity) or when the reciprocal overflowed: the slab then does not
    // narrow the interval.
    const float3 t_low = from_origin(ray, low) * ray->inv_direction;
    const float3 t_high = from_origin(ray, high) * ray->inv_direction;
    narrow_interval(t_low.x, t_high.x, ray->inv_direction.x, t_near, t_far);
    narrow_interval(t_low.y, t_high.y, ray->inv_direction.y, t_near, t_far);
    narrow_interval(t_low.z, t_high.z, ray->inv_direction.z, t_near, t_far);
    return *t_near <= *t_far;
}

// Whether a hit at t (in the ray's own units) on `primitive` is inside the limits and nearer than *hit; of two hits at the
// same t the lower number wins, so that the answer does not depend on the order of the tests.
bool is_nearer(const Ray* ray, const Hit* hit, float t, uint primitive) {
    return t >= ray->t_near && t <= ray->t_far && (t < hit->t || (t == hit->t && primitive < hit->primitive));
}

// The point of triangle p0 p1 p2 with weights u and v of vertices 1 and 2, as *high + *low, where *high is that rounded: a point of
// a distant triangle is known better than float32 can say.
void point_on_triangle(float3 p0, float3 p1, float3 p2, float u, float v, float3* high, float3* low) {
    const float3 from_p0 = fma3(p1 - p0, u, (p2 - p0) * v);
    const float3 sum = p0 + from_p0; // and its rounding error, exactly (Knuth's TwoSum)
    const float3 part = sum - p0;
    *high = sum;
    *low = (p0 - (sum - part)) + (from_p0 - part);
}

// A bound of the distance between that point and the triangle's plane, on each axis. To first order in EPSILON, with E the largest
// component of the edges and u + v <= 1: the edges round by E, the product by v E, and the sum of at most E by E.
float point_error(float3 p0, float3 p1, float3 p2) {
    return 4.0f * EPSILON * max_or(max_component(abs3(p1 - p0)), max_component(abs3(p2 - p0)));
}

// How far, on any axis, the point of the ray at the t of a computed hit can lie outside of the box around the triangle, in units
// of EPSILON D, where D is the largest coordinate of a vertex relative to the origin. For the watertight test, to first order:
// the sheared vertices are off by 8 (two differences 2 + 2, the shear's quotient and product 2, the fma 2 because the result may
// be 2 D); the ray passes exactly through the triangle of these (the signs are exact); weights that are off by 3 each, so
// relative to their sum by 6, move the point by 6 * 2 D; t is off by 9 (the vertices' 2, three fma, two sums, a product, a
// quotient), and the shear of at most 1 passes that on: 8 + 12 + 9 = 29. Moller and Trumbore's test has no such bound: on a
// triangle seen edge-on it may report a hit anywhere, and such a hit may depend on the structure.
#define HIT_ERROR 32.0f
// With it the two differences and D itself of the tests below.
#define SLACK ((HIT_ERROR + 8.0f) * EPSILON)

// D: no corner of the box is farther from the origin on any axis. NaN or infinite for an origin that is so or nearly so.
float farthest_distance(const Ray* ray, float3 low, float3 high) {
    const float3 to_low = abs3(from_origin(ray, low));
    const float3 to_high = abs3(from_origin(ray, high));
    const float farthest = max_or(max_component(to_low), max_component(to_high));
    return is_finite3(ray->origin) ? farthest : NAN;
}

// As clip_to_box, for a box that is larger by `slack` on all sides.
bool clip_to_thick_box(const Ray* ray, float slack, float3 low, float3 high, float* t_near, float* t_far) {
    *t_near = ray->t_near;
    *t_far = ray->t_far;
    const float3 t_low = (from_origin(ray, low) - slack) * ray->inv_direction;
    const float3 t_high = (from_origin(ray, high) + slack) * ray->inv_direction;
    narrow_interval(t_low.x, t_high.x, ray->inv_direction.x, t_near, t_far);
    narrow_interval(t_low.y, t_high.y, ray->inv_direction.y, t_near, t_far);
    narrow_interval(t_low.z, t_high.z, ray->inv_direction.z, t_near, t_far);
    return *t_near <= *t_far;
}
