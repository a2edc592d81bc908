// What every traversal ends in: the triangles of a leaf, tested one after the other.
//
// Every traversal has the signature
//     bool traverse_…(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit)
// and, but for what is settled behind it (query.cl, batch.cl), finds the closest hit of the ray, or with any_hit (a
// constant at every call, so that inlining folds it away) some hit. *hit is written in the ray's own units of t; FINISH
// writes t, in the caller's units, u and v. Its primitive is NO_PRIMITIVE on a miss. Returns whether anything was hit.

// HITS says which kind of triangle test there is, and names its functions:
//     test_HITS     what becomes of *hit by a triangle that the ray may hit
//     settle_HITS   decides what test_HITS has postponed; returns whether the hit is another one now
//     finish_HITS   writes t, u and v of the hit that a traversal has found
//     is_settled_HITS     whether there is nothing to settle
//     finish_mostly_HITS  finish_HITS as far as that takes little; returns whether it did
//     surface_HITS  the weights of the hit that a traversal has found, finished or not (through a pointer, as
//                   lift_point())
//     error_HITS    how far from its triangle a ray that starts there may meet the neighbours
//     least_t_HITS  what the t of a hit that a traversal has found is not less than
// `exactly`: exact.cl. `rounded`: tests that need nothing but a function INTERSECT; its t is as good as it gets, and
// final.
#define JOIN_NAMES(a, b) a##b
#define JOIN(a, b) JOIN_NAMES(a, b)
#define TEST JOIN(test_, HITS)
#define SETTLE JOIN(settle_, HITS)
#define FINISH JOIN(finish_, HITS)
#define IS_SETTLED JOIN(is_settled_, HITS)
#define FINISH_MOSTLY JOIN(finish_mostly_, HITS)
#define SURFACE_HIT JOIN(surface_, HITS)
#define LEAVING_ERROR JOIN(error_, HITS)
#define LEAST_T JOIN(least_t_, HITS)

#ifdef INTERSECT
void test_rounded(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit* hit) {
    float t, u, v;
    if (!INTERSECT(GEOMETRY, ray, slot, &t, &u, &v)) return;
    if (!is_nearer(ray, hit, t, primitive)) return;
    hit->t = t;
    hit->u = u;
    hit->v = v;
    hit->primitive = primitive;
}
bool settle_rounded(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) { return false; }
void finish_rounded(GEOMETRY_PARAMETERS, const Ray* ray, Hit* hit) { hit->t = callers_t(ray, hit->t); }
bool is_settled_rounded(GEOMETRY_PARAMETERS) { return true; }
bool finish_mostly_rounded(GEOMETRY_PARAMETERS, const Ray* ray, Hit* hit) {
    hit->t = callers_t(ray, hit->t);
    return true;
}
void surface_rounded(GEOMETRY_PARAMETERS, const Ray* ray, const Hit* hit, SurfaceHit* at) {
    at->weight0 = max_or(0.0f, (1.0f - hit->u) - hit->v);
    at->u = hit->u;
    at->v = hit->v;
    at->primitive = hit->primitive;
}
float error_rounded(float3 p0, float3 p1, float3 p2) { return point_error(p0, p1, p2); }
float least_t_rounded(const Hit* hit) { return hit->t; }
#endif

// Whether the t of a hit that a triangle test has found is a float in the caller's units: what is farther than every
// float is not hit.
bool has_float_t(GEOMETRY_PARAMETERS, const Ray* ray, Hit hit) {
    if (!is_finite(callers_t(ray, hit.t))) FINISH(GEOMETRY, ray, &hit);
    return is_finite(hit.t);
}

// Where all hits of a ray are counted or listed, v of *hit holds how many there are so far, as bits.
uint counted_hits(const Hit* hit) { return as_uint(hit->v); }
void set_counted_hits(Hit* hit, uint count) { hit->v = as_float(count); }

#if defined(COUNT_HITS)
// Counts a triangle that the ray hits, which is in no other leaf. The last one that is asked for becomes *hit, which
// ends a traversal for any hit.
void test_for_count(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit* hit) {
    Hit found = no_hit_yet(ray);
    TEST(GEOMETRY, ray, primitive, slot, &found);
    if (found.primitive == NO_PRIMITIVE || !has_float_t(GEOMETRY, ray, found)) return;
    const uint count = counted_hits(hit) + 1u;
    set_counted_hits(hit, count);
    if (count == ray->most) hit->primitive = primitive;
}
#define TEST_OF_LEAF test_for_count
#elif defined(LIST_HITS)
// Whether a triangle that is hit comes before a hit: at a smaller t, or at the same one with a lower number.
bool comes_before(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit other) {
    const uint known = other.primitive;
    TEST(GEOMETRY, ray, primitive, slot, &other);
    return other.primitive != known;
}

// Puts a triangle that the ray hits into its place in the list, if it is not there yet. From a full one the last hit
// goes. *hit, but for v, is the last one of a full list: what lies behind it need not be looked at.
void test_for_list(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit* hit) {
    Hit found = *hit;
    TEST(GEOMETRY, ray, primitive, slot, &found);
    if (found.primitive == hit->primitive) return;

    // Most triangles are met in their order, so the last hit is looked at first; then halves.
    const uint count = counted_hits(hit), room = ray->room;
    __global Hit* list = ray->list;
    uint low = 0u, high = count == room ? room - 1u : count, middle = high - 1u;
    while (low < high) {
        if (comes_before(GEOMETRY, ray, primitive, slot, list[middle])) high = middle;
        else low = middle + 1u;
        middle = (low + high) / 2u;
    }
    if (low > 0u && list[low - 1u].primitive == primitive) return;
    const uint longer = count == room ? count : count + 1u;
    for (uint i = longer - 1u; i > low; i--) list[i] = list[i - 1u];
    list[low] = found;
    if (longer == room) *hit = list[room - 1u];
    set_counted_hits(hit, longer);
}
#define TEST_OF_LEAF test_for_list
#elif defined(AFTER_HITS)
// Tests a triangle that counts only if it comes after ray->after: at a larger t, or at the same one with a higher
// number. The two are compared as two that are both hit would be, so this is as certain as the test is.
void test_later(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit* hit) {
    if (primitive == ray->after.primitive) return;
    Hit found = *hit;
    TEST(GEOMETRY, ray, primitive, slot, &found);
    if (found.primitive != primitive || hit->primitive == primitive) return;
    if (ray->after.primitive != NO_PRIMITIVE) {
        Hit earlier = ray->after;
        TEST(GEOMETRY, ray, primitive, slot, &earlier);
        if (earlier.primitive == primitive) return;
    }
    *hit = found;
}
#define TEST_OF_LEAF test_later
#else
#define TEST_OF_LEAF TEST
#endif

// Tests the triangle of one reference.
INLINE void test_triangle(GEOMETRY_PARAMETERS, const Ray* ray, uint reference, Hit* hit) {
    const uint primitive = PRIMITIVE_OF(geometry, LOAD_REFERENCE(geometry, reference));
    if (ray->skip != NO_PRIMITIVE && primitive == ray->skip) return; // no comparison where nothing is skipped
    COUNT(geometry, TESTS, 1);
    TEST_OF_LEAF(GEOMETRY, ray, primitive, SLOT_OF(reference, primitive), hit);
}

// Tests the triangles of references first..end. True when that answers the query: any hit will do, and there is one.
// What ends the loop is in its condition, because work-items that leave it by a return of their own do not come
// together again behind it on a GPU: an H200 took 2.6 times as long for shadow rays in a kd-tree.
INLINE bool test_triangles(GEOMETRY_PARAMETERS, const Ray* ray, uint first, uint end, const bool any_hit, Hit* hit) {
    NO_UNROLLING
    for (uint i = first; i < end && !(any_hit && hit->primitive != NO_PRIMITIVE); i++)
        test_triangle(GEOMETRY, ray, i, hit);
    return any_hit && hit->primitive != NO_PRIMITIVE;
}

// The leaf that a link of a bounding volume hierarchy leads to, as a leaf record.
int4 leaf_of_link(uint link) {
    return (int4)((int)KD_LEAF, (int)(link & BVH_FIRST_MASK), (int)((link & ~BVH_LEAF) >> BVH_COUNT_SHIFT), 0);
}

// test_triangles() for the references of a leaf record {KD_LEAF, first, count, _}.
INLINE bool test_leaf(GEOMETRY_PARAMETERS, const Ray* ray, int4 leaf, const bool any_hit, Hit* hit) {
    COUNT(geometry, LEAVES, 1);
    COUNT(geometry, EMPTY_LEAVES, leaf.z == 0 ? 1 : 0);
    return test_triangles(GEOMETRY, ray, (uint)leaf.y, (uint)leaf.y + (uint)leaf.z, any_hit, hit);
}
