// Slab tests of boxes at one fma a plane: when a ray enters and leaves the space between two planes, a little early and
// a little late. Kay and Kajiya, "Ray Tracing Complex Scenes", SIGGRAPH 1986; the offsets are those of Aila and Laine,
// "Understanding the Efficiency of Ray Traversal on GPUs", HPG 2009; conservative in the spirit of Ize, "Robust BVH Ray
// Traversal", JCGT 2(2), 2013, but for the errors of the triangle tests, too.
//
// On an axis with origin o, direction d and inv = 1 / d the ray meets the plane p at t = (p - o) inv = fma(p, inv, -o
// inv). The offset is lowered by the ray's padding for planes where it enters, and raised by it for those where it
// leaves, once for each ray:
//     t_enter <= the t of any hit in the box <= t_leave,  for every box within the scene's, every ray and every
//                                                         triangle test.
//
// The padding. D is no less than the distance on any axis of any point of the scene's box from the start
// (farthest_distance in ray.cl), and |d| is at least 1 on some axis, so the hits that matter have |t| <= D (1 + SLACK).
// On each axis, in units of |inv|:
//   - the hit's point may lie HIT_ERROR EPSILON D away from the nearest point of its triangle (ray.cl), which is in the
//     box of some leaf that lists the triangle;
//   - inv is off by 5 EPSILON of itself (2.5 ulp, on devices whose division is no better) and the fma by EPSILON of its
//     result: as t is (p - o) inv and |p - o| <= D, together 6 EPSILON D; two fma, for planes that are a middle and
//     half an extent, 7 EPSILON D;
//   - a direction below LEAST_SLAB_DIRECTION is taken for that, so that nothing overflows: it moves the point at t by
//     no more than EPSILON D / 4. A zero component is one of these: boxes that the ray runs beside are culled, those
//     that it touches are not;
//   - the second part of the origin, which is left out, is at most EPSILON |o|; the product -o inv is off by as much;
//     and so is its sum with the padding, beside EPSILON of the padding: 3 EPSILON |o|.
// HIT_ERROR + 7.25 is below SLACK / EPSILON = HIT_ERROR + 8, and 3 below 4 (ORIGIN_ERROR), which leaves room for the
// second order. LEAST_PADDING is for what underflows, here or on devices without the smallest numbers: half a dozen
// times 2^-126, on the scale of t, where |inv| > 1/2.
//
// From FARTHEST_START on, where the padding has long been larger than the scene, an offset could overflow: such a ray
// meets every box. So every number here is one: neither NaN nor, but for these rays' offsets, infinite.

// Of a ray. The near plane of a slab is the upper one where inv < 0.
typedef struct {
    float3 inv;
    float3 enter; // t_enter = fma(near plane, inv, enter)
    float3 leave; // t_leave = fma(far plane, inv, leave)
} Slabs;

float slab_inverse(float direction, float least) {
    return 1.0f / (fabs(direction) >= least ? direction : direction < 0.0f ? -least : least);
}

// Those of a ray that meets every box.
Slabs all_slabs(void) {
    const Slabs slabs = {(float3)(0.0f), (float3)(-INFINITY), (float3)(INFINITY)};
    return slabs;
}

// Those whose planes are `thickness` away from where they are, on both sides.
Slabs thick_slabs(float3 origin, float3 inv, float3 thickness) {
    const float3 padding = thickness * abs3(inv);
    const float3 at_origin = -(origin * inv);
    const Slabs slabs = {inv, at_origin - padding, at_origin + padding};
    return slabs;
}

float3 slab_inverses(const Ray* ray) {
    return (float3)(slab_inverse(ray->direction.x, LEAST_SLAB_DIRECTION),
                    slab_inverse(ray->direction.y, LEAST_SLAB_DIRECTION),
                    slab_inverse(ray->direction.z, LEAST_SLAB_DIRECTION));
}

// D for boxes within low..high of a scene of which few triangles lie so far out that a padding for them would be larger
// than all the rest (src/accel/near.rs): from a start that is within `near_reach` of 0 on all axes, no point of a box
// that is within it, too, is farther away than twice that. Boxes that reach beyond are larger by what is left out here.
// In other scenes near_reach is 0, also for a start at 0.
float padding_distance(const Ray* ray, float3 low, float3 high, float near_reach) {
    const float farthest = farthest_distance(ray, low, high), nearer = 2.0f * near_reach;
    const bool is_near = nearer > 0.0f && largest_component(abs3(ray->origin)) <= near_reach;
    return is_near && nearer < farthest ? nearer : farthest;
}

// For boxes within low..high.
Slabs make_slabs(const Ray* ray, float3 low, float3 high, float near_reach) {
    const float distance = padding_distance(ray, low, high, near_reach);
    if (!(distance < FARTHEST_START)) return all_slabs();
    const float thickness = fma(SLACK, distance, LEAST_PADDING);
    return thick_slabs(ray->origin, slab_inverses(ray), fma3(abs3(ray->origin), ORIGIN_ERROR, (float3)(thickness)));
}

// Whether boxes that are larger by `padding` than what they hold need no padding of this ray. So it is for most:
// padding_of_boxes() in src/bounds.rs.
bool is_padding_enough(const Ray* ray, float3 low, float3 high, float near_reach, float padding) {
    const float thickness = fma(SLACK, padding_distance(ray, low, high, near_reach), LEAST_PADDING);
    return fma(largest_component(abs3(ray->origin)), ORIGIN_ERROR, thickness) <= padding;
}

// Those without padding.
Slabs slabs_without_padding(const Ray* ray) {
    const float3 inv = slab_inverses(ray), at_origin = -(ray->origin * inv);
    const Slabs slabs = {inv, at_origin, at_origin};
    return slabs;
}

#ifdef INSTANCES
// For boxes within an object: of the ray as the rows of an instance take it to the object's coordinates. There t is the
// same. `reach` is what these rows make of a difference at most, R on an axis, with a quarter to spare; o' and d' are
// the origin and direction in the object. The padding in the object's units, where the hit's point as computed from o'
// and d' is off the object's triangle, in EPSILON:
//   - by what it is off in tracing space, HIT_ERROR D, as far as R takes it;
//   - by the rounding of the triangle's vertices when they were placed, 3 R Q for coordinates up to Q;
//   - by the rounding of o', 4 R |o| + 4 R Q, because the rows' summands are no larger than R Q, and by what it leaves
//     out, R |o|;
//   - by the rounding of d' times t, 4 R D, and by its least value, R D / 4;
//   - by the slab's own arithmetic as above: 7 (|o'| + X) for boxes that reach to X, and 3 |o'|.
// So R ((HIT_ERROR + 4.25) D + 5 |o| + 7 Q) + 10 |o'| + 7 X: below R (SLACK / EPSILON D + 8 |o|) + 12 |o'| + blur,
// where blur is what does not depend on the ray, R (8 Q + LEAST_PADDING) + 8 X, with a quarter to spare:
// TRANSFORM_ERROR is the 8, OBJECT_ORIGIN_ERROR the 12.
//
// From THICKEST on the padding may overflow, and directions, whose components may be 2^60 times as large as those of
// others (make_ray): such a ray meets every box, and so does one that is no number in the object.

// False for NaN.
bool is_below3(float3 v, float limit) { return v.x < limit && v.y < limit && v.z < limit; }

Slabs make_instance_slabs(const Ray* ray, float3 low, float3 high, float4 row0, float4 row1, float4 row2, float3 reach,
                          float3 blur) {
    const float distance = farthest_distance(ray, low, high);
    const float3 o = ray->origin, d = ray->direction;
    const float3 origin = (float3)(row_times_point(row0, o), row_times_point(row1, o), row_times_point(row2, o));
    const float3 direction =
        (float3)(row_times_direction(row0, d), row_times_direction(row1, d), row_times_direction(row2, d));
    const float from_ray = fma(SLACK, distance, TRANSFORM_ERROR * max_component(abs3(o)));
    const float3 thickness = fma3(reach, from_ray, fma3(abs3(origin), OBJECT_ORIGIN_ERROR, blur));
    if (!(distance < FARTHEST_START && is_below3(abs3(direction), THICKEST) && is_below3(thickness, THICKEST)))
        return all_slabs();
    const float3 inv = (float3)(slab_inverse(direction.x, reach.x * LEAST_SLAB_DIRECTION),
                                slab_inverse(direction.y, reach.y * LEAST_SLAB_DIRECTION),
                                slab_inverse(direction.z, reach.z * LEAST_SLAB_DIRECTION));
    return thick_slabs(origin, inv, thickness);
}
#endif

// The same for two boxes at a time. On each axis a box is {middle, half_size}, half of its size: so a slab takes three
// fma, where its planes take a selection for each or four fma, and none need know which plane is the near one. A box is
// missed where t_enter <= t_leave is not true. No number here is NaN.
#ifdef GPU
typedef Slabs PairSlabs;

PairSlabs make_pair_slabs(const Slabs* s) { return *s; }

// By their bits, of which GPUs have instructions that take three numbers (an H200 traces 1.01 to 1.05 times as fast).
// With `limit` no less than 0, and not -0, the largest is that of the numbers; the least, too, or both are below 0.
float largest_by_bits(float3 v, float limit) {
    return as_float(max(max(as_int(v.x), as_int(v.y)), max(as_int(v.z), as_int(limit))));
}
float least_by_bits(float3 v, float limit) {
    return as_float(min(min(as_int(v.x), as_int(v.y)), min(as_int(v.z), as_int(limit))));
}

// {t_enter, -t_leave} of a box.
float2 clip_to_middle(const Slabs* s, float t_near, float t_limit, const bool by_bits, float3 middle,
                      float3 half_size) {
    const float3 half_inv = abs3(s->inv);
    const float3 enter = fma(-half_size, half_inv, fma(middle, s->inv, s->enter));
    const float3 leave = fma(half_size, half_inv, fma(middle, s->inv, s->leave));
    if (by_bits) return (float2)(largest_by_bits(enter, t_near), -least_by_bits(leave, t_limit));
    return (float2)(fmax(fmax(enter.x, enter.y), fmax(enter.z, t_near)),
                    -fmin(fmin(leave.x, leave.y), fmin(leave.z, t_limit)));
}
#else
// In vectors of four, for what has such registers. An interval is {t_enter, -t_leave}, so that both bounds narrow by
// fmax(). Two axes, or one twice.
typedef struct {
    float4 inv;      // inv, -inv of each
    float4 offset;   // enter, -leave
    float4 half_inv; // -|inv|, twice
} AxisPair;

typedef struct {
    AxisPair xy, zz;
} PairSlabs;

AxisPair axis_pair(float2 inv, float2 enter, float2 leave) {
    const AxisPair pair = {(float4)(inv.x, -inv.x, inv.y, -inv.y), (float4)(enter.x, -leave.x, enter.y, -leave.y),
                           -fabs(inv).xxyy};
    return pair;
}

PairSlabs make_pair_slabs(const Slabs* s) {
    const PairSlabs pair = {axis_pair(s->inv.xy, s->enter.xy, s->leave.xy),
                            axis_pair(s->inv.zz, s->enter.zz, s->leave.zz)};
    return pair;
}

// {t_enter, -t_leave} of {middle, half_size} of each axis.
float4 times_of_slabs(const AxisPair* a, float4 slabs) {
    return fma(slabs.yyww, a->half_inv, fma(slabs.xxzz, a->inv, a->offset));
}
#endif

// Where the ray enters and leaves two boxes, {t_enter, -t_leave} of each, no wider than `t_near` and `t_limit` are. The
// boxes are {middle.x, half_size.x, middle.y, half_size.y} of each, and z of both. by_bits: that t_near is no less than
// 0, and not -0.
float4 clip_to_pair(const PairSlabs* s, float t_near, float t_limit, const bool by_bits, float4 xy0, float4 xy1,
                    float4 zz) {
#ifdef GPU
    return (float4)(clip_to_middle(s, t_near, t_limit, by_bits, (float3)(xy0.xz, zz.x), (float3)(xy0.yw, zz.y)),
                    clip_to_middle(s, t_near, t_limit, by_bits, (float3)(xy1.xz, zz.z), (float3)(xy1.yw, zz.w)));
#else
    const float4 t0 = times_of_slabs(&s->xy, xy0), t1 = times_of_slabs(&s->xy, xy1), tz = times_of_slabs(&s->zz, zz);
    const float4 tx = (float4)(t0.xy, t1.xy), ty = (float4)(t0.zw, t1.zw);
    return fmax(fmax(tx, ty), fmax(tz, (float4)(t_near, -t_limit, t_near, -t_limit)));
#endif
}
