// Rays, their limits, what shears triangles along them, and how a ray leaves a surface. Where most rounding bounds are
// derived; the numbers are in src/shared/constants.rs. EPSILON is the largest relative error of one rounding.

// v with the component of `axis` and that of z exchanged. Mirrors where they are two; an even permutation would take a
// GPU six selections.
float3 swap_to_z(float3 v, uint axis) {
    return (float3)(axis == 0u ? v.z : v.x, axis == 1u ? v.z : v.y, axis == 0u ? v.x : axis == 1u ? v.y : v.z);
}

// The axis of the largest component of a direction.
uint major_axis(float3 direction) {
    const float3 size = abs3(direction);
    return size.x >= size.y ? (size.x >= size.z ? 0u : 2u) : (size.y >= size.z ? 1u : 2u);
}

// By how much z moves x along a direction: x / z, off by EPSILON of itself, whatever a device's division is off by.
float shear_towards(float x, float z, float inv_z) {
    const float shear = x * inv_z;
    return fma(fma(-shear, z, x), inv_z, shear);
}

// What shears triangles (watertight.cl) so that a direction is the z axis: the axis of its largest component becomes z,
// and x and y are sheared along it.
typedef struct {
    uint axis;
    float x, y;
    float z, inv_z; // of the direction, along the axis
} Shear;

Shear shear_along(float3 v) {
    const uint axis = major_axis(v);
    const float3 direction = swap_to_z(v, axis);
    const float inv_z = 1.0f / direction.z;
    const Shear shear = {axis, shear_towards(direction.x, direction.z, inv_z),
                         shear_towards(direction.y, direction.z, inv_z), direction.z, inv_z};
    return shear;
}

// A ray ready for traversal. The direction is scaled by a power of two to a largest component in [1, 2), which is exact
// and makes every later step independent of the caller's units; t here is the caller's t / t_lift / t_scale. Where it
// would not be exact, because another component is over 2^126 times smaller, the largest is in [2^60, 2^61), whose
// square is a float: a ray from far away turns by so little.
typedef struct {
    float3 origin;
    float3 origin_low;    // the ray starts at origin + origin_low; not larger than origin's rounding. start_on_triangle
    float3 direction;
    float3 inv_direction; // +infinity for a zero component; NaN where the reciprocal overflows: no plane decides there
    Shear shear;          // here because not every compiler moves divisions out of the loop over triangles
    float t_near, t_far;  // closed interval, off by less than a float's last bit; t_far is finite or -infinity
    float t_min, t_max;   // the interval as it was given, in the caller's units: where exact integers decide
    float t_scale, t_lift; // two factors, because one would overflow for the shortest directions
    uint skip;            // triangle that is never hit: the one that the ray starts on
    // Where on it: weights of its vertices; the largest is -1, which means what the others leave of 1. Or all 0: the
    // ray starts at origin, as a camera ray does.
    float3 start_weights;
#ifdef AFTER_HITS
    Hit after; // what was found before, as a traversal leaves it: hits that do not come after it do not count
#endif
#ifdef COUNT_HITS
    uint most; // so many hits are counted, and no more
#endif
#ifdef LIST_HITS
    __global Hit* list; // the hits found so far, as a test leaves them, the closest first
    uint room;          // so many of them are kept
#endif
} Ray;

// t in the caller's units: exactly, where it is a normal number in both.
float callers_t(const Ray* ray, float t) { return t * ray->t_lift * ray->t_scale; }
// The power of two by which the caller's t is the ray's.
int t_exponent(const Ray* ray) { return exponent_field(ray->t_lift) + exponent_field(ray->t_scale) - 254; }
bool is_normal(float x) { return fabs(x) >= FLT_MIN && fabs(x) <= FLT_MAX; }

// A power of two mostly has an inverse that is a normal number, and a product with that rounds as the division does.
bool has_inverse(float power) { return as_uint(power) - 0x00800000u <= 0x7e000000u; }
float inverse_power(float power) { return as_float(0x7f000000u - as_uint(power)); }

// Calls, because they are rare.
RARE float divide_by_power(float x, float power) { return x / power; }

float clamp_to_floats(float t) { return min_or(max_or(t, -FLT_MAX), FLT_MAX); }

// What becomes of a limit, given as a float that is no infinity, by both divisions. It is off by less than the last bit
// of a float, which the tests know (place_hit in exact_filter.cl), and only where it is subnormal: both factors are
// above 1, or both below. A limit that is not 0 does not become 0: what is met where the ray starts stays outside.
float own_limit(float limit, float divided) {
    const float own = clamp_to_floats(divided);
    return own == 0.0f && limit != 0.0f ? (limit < 0.0f ? as_float(0x80000001u) : as_float(1u)) : own;
}

// Sets the interval, in the caller's units; to an empty one where the ray is not sound. Infinity ends at the largest
// float of the caller's: nothing farther is hit.
void limit_ray(Ray* ray, bool sound, float t_min, float t_max) {
    ray->t_min = t_min;
    ray->t_max = t_max;
    const float limit_min = clamp_to_floats(t_min), limit_max = clamp_to_floats(t_max);
    float t_near, t_far;
    if (has_inverse(ray->t_lift) && has_inverse(ray->t_scale)) {
        const float inv_lift = inverse_power(ray->t_lift), inv_scale = inverse_power(ray->t_scale);
        t_near = limit_min * inv_lift * inv_scale;
        t_far = limit_max * inv_lift * inv_scale;
    } else {
        t_near = divide_by_power(divide_by_power(limit_min, ray->t_lift), ray->t_scale);
        t_far = divide_by_power(divide_by_power(limit_max, ray->t_lift), ray->t_scale);
    }
    ray->t_near = sound ? own_limit(limit_min, t_near) : INFINITY;
    ray->t_far = sound ? own_limit(limit_max, t_far) : -INFINITY;
}

// Numbers from its reciprocal up to this, and 0, lose no bits here and in packets, and nothing that is made of them
// overflows.
#define MODERATE 0x1p40f

// Bitwise, because a GPU takes less time for a comparison than for a branch around it.
bool is_moderate3(float3 v) {
    const float3 size = abs3(v);
    const int3 moderate = (v == (float3)(0.0f)) | ((size >= (float3)(1.0f / MODERATE)) & (size <= (float3)(MODERATE)));
    return all(moderate);
}

// Whether a number has lost bits when it was scaled, or may have, which it keeps if it is lifted. Where it has, scale
// and lift are no larger than 2^83 together; elsewhere their product may be infinite.
bool is_too_small(float x, float scaled, float lifted) { return x != 0.0f && fabs(scaled) < FLT_MIN && lifted != 0.0f; }

float reciprocal_or_nan(float x) {
    const float r = 1.0f / x;
    return x != 0.0f && !is_finite(r) ? NAN : r;
}

// Where p lies as seen from the start of the ray. The first difference rounds once and is exact where the second part
// matters (Sterbenz): where both are of like size. The second part itself is off by 2 EPSILON. So the result is off by
// at most 5 EPSILON of itself: it is half the first difference or more, and not smaller than the second part.
float3 from_origin(const Ray* ray, float3 p) { return (p - ray->origin) - ray->origin_low; }

// Makes a ray that starts at `origin`, but for its limits. False for one with NaN or infinite parts or without
// direction.
bool aim_ray(Ray* ray, float3 origin, float3 direction, uint skip) {
    ray->skip = skip;
    ray->start_weights = (float3)(0.0f);
    ray->origin = origin;
    ray->origin_low = (float3)(0.0f);
    ray->t_scale = 1.0f;
    ray->t_lift = 1.0f;
    bool sound = is_finite3(origin);
    const float3 size = abs3(direction);
    const float longest = largest_component(size);
    if (is_moderate3(direction) && longest > 0.0f) {
        ray->t_scale = power_of_two_scale(longest); // what the rest comes to for these
        direction *= ray->t_scale;
    } else {
        if (max_component(size) < SHORT_DIRECTION) {
            direction *= LIFT;
            ray->t_lift = LIFT;
        }
        const float3 given = direction;
        sound = scale_to_unit(&direction, &ray->t_scale) && sound;
        const float3 lifted = given * (ray->t_scale * SMALL_TURN_LIFT);
        if (is_too_small(given.x, direction.x, lifted.x) || is_too_small(given.y, direction.y, lifted.y) ||
            is_too_small(given.z, direction.z, lifted.z)) {
            ray->t_scale *= SMALL_TURN_LIFT;
            direction = lifted;
        }
    }
    // A zero component has one reciprocal.
    direction = (float3)(positive_zero(direction.x), positive_zero(direction.y), positive_zero(direction.z));
    ray->direction = direction;
    ray->shear = shear_along(direction);
    ray->inv_direction =
        (float3)(reciprocal_or_nan(direction.x), reciprocal_or_nan(direction.y), reciprocal_or_nan(direction.z));
    return sound;
}

// A ray with its limits. One that is not sound gets an empty interval: it misses everything.
ONE_COPY Ray make_ray(float3 origin, float3 direction, float t_near, float t_far, uint skip) {
    Ray ray;
    const bool sound = aim_ray(&ray, origin, direction, skip);
    limit_ray(&ray, sound && t_near <= t_far, t_near, t_far);
    return ray;
}

// t rounded away from and towards -infinity by more than its error. Products, so that infinity stays infinity and NaN
// NaN. The t of a plane: a difference from the origin's two parts, off by 5 EPSILON (see from_origin), one reciprocal
// and one product: within gamma(7) < 8 EPSILON (Higham, "Accuracy and Stability of Numerical Algorithms", 2002, section
// 3.1). The product with the factor itself rounds once more: 9, and the factors WIDEN_UP and WIDEN_DOWN are exact
// floats with 10 to have one to spare.
float widen_up(float t) { return t * (t > 0.0f ? WIDEN_UP : WIDEN_DOWN); }
float widen_down(float t) { return t * (t > 0.0f ? WIDEN_DOWN : WIDEN_UP); }

// Beside the relative error a plane's distance from the origin has one that does not shrink with it: what the second
// part of the start leaves out, below 2^-66 of vertices below 2 (rounding_errors.cl), or all of that part where no
// float is so small. PLANE_ERROR is twice that. Without it the product with a large reciprocal made much of nothing,
// and one that is subnormal was not widened by any factor.

// Narrows *t_near..*t_far to the time between two planes, a little more rather than less. The comparisons are false for
// NaN.
void narrow_interval(float t_low, float t_high, float inv_direction, float* t_near, float* t_far) {
    const bool ascending = inv_direction >= 0.0f;
    const float t_enter = widen_down(ascending ? t_low : t_high);
    const float t_leave = widen_up(ascending ? t_high : t_low);
    if (t_enter > *t_near) *t_near = t_enter;
    if (t_leave < *t_far) *t_far = t_leave;
}

// The part of the ray inside the box, a little more rather than less. False when there is none.
// Kay and Kajiya, "Ray Tracing Complex Scenes", SIGGRAPH 1986; conservative as in Ize, "Robust BVH Ray Traversal", JCGT
// 2013.
bool clip_to_box(const Ray* ray, float3 low, float3 high, float* t_near, float* t_far) {
    *t_near = ray->t_near;
    *t_far = ray->t_far;
    // A NaN arises when the reciprocal overflowed, or from 0 * infinity: the slab then does not narrow the interval.
    const float3 t_low = (from_origin(ray, low) - PLANE_ERROR) * ray->inv_direction;
    const float3 t_high = (from_origin(ray, high) + PLANE_ERROR) * ray->inv_direction;
    narrow_interval(t_low.x, t_high.x, ray->inv_direction.x, t_near, t_far);
    narrow_interval(t_low.y, t_high.y, ray->inv_direction.y, t_near, t_far);
    narrow_interval(t_low.z, t_high.z, ray->inv_direction.z, t_near, t_far);
    return *t_near <= *t_far;
}

Hit no_hit(void) {
    const Hit hit = {INFINITY, 0.0f, 0.0f, NO_PRIMITIVE};
    return hit;
}

// What a traversal begins with: its t, and u where that is a limit of t (exact.cl), are where the ray ends, so that
// nothing behind that is nearer.
Hit no_hit_yet(const Ray* ray) {
    const Hit hit = {ray->t_far, ray->t_far, 0.0f, NO_PRIMITIVE};
    return hit;
}

// Whether a hit at t (in the ray's own units) on `primitive` is inside the limits and nearer than *hit, which began as
// no_hit_yet(); of two hits at the same t the lower number wins, so that the answer does not depend on the order of the
// tests.
bool is_nearer(const Ray* ray, const Hit* hit, float t, uint primitive) {
    return t >= ray->t_near && (t < hit->t || (t == hit->t && primitive < hit->primitive));
}

// Whether the ray starts at an exact point of triangle `skip`.
bool starts_on_triangle(const Ray* ray) {
    return ray->start_weights.x < 0.0f || ray->start_weights.y < 0.0f || ray->start_weights.z < 0.0f;
}

// A point of a triangle, exactly: base + weight1 (other1 - base) + weight2 (other2 - base).
typedef struct {
    float3 base, other1, other2;
    float weight1, weight2;
} TrianglePoint;

// That of weights as Ray has them. Relative to the vertex with the largest weight, the two that are stored may be as
// small as floats can be: the point lies on an edge or a vertex just when it should, and never beyond.
TrianglePoint point_of_weights(float3 p0, float3 p1, float3 p2, float3 weights) {
    const bool at0 = weights.x < 0.0f, at1 = weights.y < 0.0f;
    const TrianglePoint point = {at0 ? p0 : at1 ? p1 : p2, at0 ? p1 : at1 ? p2 : p0, at0 ? p2 : at1 ? p0 : p1,
                                 at0 ? weights.y : at1 ? weights.z : weights.x,
                                 at0 ? weights.z : at1 ? weights.x : weights.y};
    return point;
}

// Whether vertex 0 has the largest weight, so that what u and v leave of 1 is as good as the float nearest to it.
bool is_nearest_vertex0(float u, float v) {
    const float rest = (1.0f - u) - v;
    return rest >= u && rest >= v;
}

// Where a ray starts that leaves a triangle: the exact point, rounded to *high, and the rest, rounded to *low
// (rounding_errors.cl).
ONE_COPY void start_on_triangle(const TrianglePoint* point, float3* high, float3* low) {
    point_of_triangle3(point->base, point->other1, point->other2, point->weight1, point->weight2, high, low);
}

// What a float32 triangle test may be off from the plane of a neighbour that shares the point where a ray starts, on
// each axis. To first order in EPSILON, with E the largest component of the edges: the vertices' differences from the
// point, of up to E, round by 2 E, and as much once more in the sum that weighs them: POINT_ERROR E.
float point_error(float3 p0, float3 p1, float3 p2) {
    return POINT_ERROR * max_or(max_component(abs3(p1 - p0)), max_component(abs3(p2 - p0)));
}

// How far, on any axis, the point of the ray at the t of a computed hit can lie from some point of the triangle, and so
// outside of boxes that hold all of it between them, in units of EPSILON D, where D is the largest coordinate of a
// vertex relative to the origin. For the watertight test, to first order: the sheared vertices are off by 8 (two
// differences 2 + 2, the shear up to 2, the fma 2 because the result may be 2 D); the ray passes exactly through the
// triangle of these (the signs are exact); weights that are off by 3 each, so relative to their sum by 6, move the
// point by 6 * 2 D; t is off by 9 (the vertices' 2, three fma, two sums, a product, a quotient), and the shear of at
// most 1 passes that on: 8 + 12 + 9 = 29. Moller and Trumbore's test has no such bound: on a triangle seen edge-on it
// may report a hit anywhere, and such a hit may depend on the structure. HIT_ERROR is 32; SLACK, in units of D, leaves
// 8 more for the two differences and D itself of the tests below.

// D: no corner of the box is farther from the origin on any axis. NaN or infinite for an origin that is so or nearly
// so.
float farthest_distance(const Ray* ray, float3 low, float3 high) {
    const float3 to_low = abs3(from_origin(ray, low));
    const float3 to_high = abs3(from_origin(ray, high));
    const float farthest = larger(largest_component(to_low), largest_component(to_high));
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
