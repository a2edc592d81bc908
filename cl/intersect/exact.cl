// Ray-triangle intersection that is right: what the traversals call. The steps are in exact_filter.cl, exact_closer.cl,
// exact_integers.cl and ties.cl.

// What step 2 leaves open, as place_hit tells it; limits of its t, and which weights are surely zero.
INLINE int decide_closely(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, uint primitive,
                          const Hit* hit, float* t_low, float* t_high, uint* zeros) {
#ifdef EXTENDED_IS_DOUBLE
    const Corners corners = {p0, p1, p2};
    const bool has_best = hit->primitive != NO_PRIMITIVE;
    const Corners best = {has_best ? LOAD_SURFACE_VERTEX(geometry, hit->primitive, 0) : p0,
                          has_best ? LOAD_SURFACE_VERTEX(geometry, hit->primitive, 1) : p1,
                          has_best ? LOAD_SURFACE_VERTEX(geometry, hit->primitive, 2) : p2};
    const CloserLimits limits = {
        ray->t_near, ray->t_far, hit->u, hit->t, best, has_best, primitive < hit->primitive, starts_on_triangle(ray)};
    const ExtendedDecision closer =
        decide_closer(start_of_ray(GEOMETRY, ray), ray->direction, &corners, &limits, zeros);
    *t_low = closer.t_low;
    *t_high = closer.t_high;
    if (closer.decision != UNDECIDED) return closer.decision;
#endif
    return DECIDE_BY_INTEGERS(geometry, decide_by_integers(GEOMETRY, ray, p0, p1, p2, primitive, hit, t_low, t_high))
               ? HIT
               : MISS;
}

// Whether two triangles lie in one plane across an axis, so that a ray meets both at the same t: most of those that no
// rounded arithmetic can tell apart, and there exact integers are not needed to say so (of 3,836 camera rays through
// gears these are left for 18).
bool are_in_one_axis_plane(float3 p0, float3 p1, float3 p2, float3 q0, float3 q1, float3 q2) {
    const int3 same = p0 == p1 && p0 == p2 && p0 == q0 && p0 == q1 && p0 == q2;
    return any(same);
}

// Whether a triangle lies in a plane across an axis, and a ray of that direction goes along it: D is 0, so it is not
// hit. Such are the walls of a room to rays along its axes, which else take the most precision.
bool is_in_plane_along(float3 direction, float3 p0, float3 p1, float3 p2) {
    const int3 along = direction == (float3)(0.0f) && p0 == p1 && p0 == p2;
    return any(along);
}

// What ties.cl tells of a triangle that step 2 leaves open, but for that it `is_hit`, or that the ray `crosses` its
// plane: beside the nearest hit so far the lower number wins, and what lies in the plane that a ray leaves, or is that
// triangle once more, is met at t = 0, which is not a hit. Where the nearest hit so far is at a vertex or an edge, as
// the bits of its weights that are zero tell, and that is this triangle's, too, *zeros gets those of this one.
ONE_COPY int decide_tie(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, uint primitive,
                        const Hit* hit, bool is_hit, bool crosses, uint zeros_of_hit, uint* zeros) {
    if (hit->primitive != NO_PRIMITIVE) {
        const float3 q0 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 0);
        const float3 q1 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 1);
        const float3 q2 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 2);
#ifdef EXTENDED_IS_DOUBLE
        const Corners corners = {p0, p1, p2}, other = {q0, q1, q2};
        *zeros = crosses ? zeros_of_same_point(zeros_of_hit, &other, &corners) : 0u;
        if (*zeros != 0u) return primitive < hit->primitive ? HIT : MISS;
#endif
        if (are_same_points(p0, p1, p2, q0, q1, q2) ||
            (is_hit && (are_in_one_axis_plane(p0, p1, p2, q0, q1, q2) || are_in_one_plane(p0, p1, p2, q0, q1, q2))))
            return primitive < hit->primitive ? HIT : MISS;
    }
    if (starts_on_triangle(ray) && ray->t_near >= 0.0f) {
        const float3 q0 = LOAD_SURFACE_VERTEX(geometry, ray->skip, 0);
        const float3 q1 = LOAD_SURFACE_VERTEX(geometry, ray->skip, 1);
        const float3 q2 = LOAD_SURFACE_VERTEX(geometry, ray->skip, 2);
        if (are_same_points(p0, p1, p2, q0, q1, q2) || are_in_one_axis_plane(p0, p1, p2, q0, q1, q2) ||
            are_in_one_plane(p0, p1, p2, q0, q1, q2))
            return MISS;
    }
    return UNDECIDED;
}

// Whether a triangle that step 1 leaves open is the nearest hit so far; limits of its t, and the bits of its weights
// that are surely zero. `zeros_of_hit`: those of *hit.
ONE_COPY bool decide_undecided(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, uint primitive,
                               const Hit* hit, uint zeros_of_hit, float* t_low, float* t_high, uint* zeros) {
    *zeros = 0u;
    if (is_in_plane_along(ray->direction, p0, p1, p2)) return false;
    COUNT(geometry, EXTENDED_TESTS, 1);
    const ExtendedDecision extended = decide_extended(ray->origin, ray->origin_low, ray->direction, p0, p1, p2);
    *t_low = extended.t_low;
    *t_high = extended.t_high;
    int decision = extended.decision == HIT ? place_hit(ray, hit, extended.t_low, extended.t_high) : extended.decision;
    if (decision == UNDECIDED) {
        COUNT(geometry, CLOSE_TESTS, 1);
        const int tie = decide_tie(GEOMETRY, ray, p0, p1, p2, primitive, hit, extended.decision == HIT,
                                   extended.crosses, zeros_of_hit, zeros);
        if (tie == HIT) {
            *t_low = hit->u;
            *t_high = hit->t;
        }
        if (tie != UNDECIDED) return tie == HIT;
        decision = decide_closely(GEOMETRY, ray, p0, p1, p2, primitive, hit, t_low, t_high, zeros);
    }
    return decision == HIT;
}

bool is_settled_exactly(GEOMETRY_PARAMETERS) {
#ifdef DEFER_UNDECIDED
    return geometry->undecided->count == 0u;
#else
    return true;
#endif
}

// t in the caller's units, if it is wanted, and the weights that step 2 is not sure of.
INLINE void finish_closely(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, const bool wants_t,
                           float* t, SurfaceHit* hit) {
#ifdef EXTENDED_IS_DOUBLE
    const Corners corners = {p0, p1, p2};
    const FinishedHit closer = finish_closer(start_of_ray(GEOMETRY, ray), ray->direction, &corners);
    const float callers = callers_t(ray, closer.t);
    if (closer.is_sure && (!wants_t || closer.at_start || (is_normal(closer.t) && is_normal(callers)))) {
        if (wants_t) *t = callers;
        hit->u = closer.u;
        hit->v = closer.v;
        hit->weight0 = closer.weight0;
        return;
    }
#endif
    (void)DECIDE_BY_INTEGERS(geometry, finish_by_integers(GEOMETRY, ray, p0, p1, p2, t, hit));
}

// A triangle test of its own kind (HITS in cl/traverse/leaf.cl): what is kept of the nearest hit while the traversal
// goes on are limits of its t, t above and u below.
ONE_COPY void test_exactly(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, uint slot, Hit* hit) {
    if (IS_MET_AGAIN(primitive, hit)) return;
    const float3 p0 = LOAD_VERTEX(geometry, slot, 0);
    const float3 p1 = LOAD_VERTEX(geometry, slot, 1);
    const float3 p2 = LOAD_VERTEX(geometry, slot, 2);
    const ShearedTriangle sheared = shear_triangle(ray, p0, p1, p2);
    const ShearedTriangle* s = &sheared;
    const Edges e = edges_of(s->error, s->ax, s->ay, s->az, s->bx, s->by, s->bz, s->cx, s->cy, s->cz);
    if (surely_missed(e)) return;
    float t_low, t_high;
    const int decision = decide_rounded(s, e, &t_low, &t_high), place = place_hit(ray, hit, t_low, t_high);
    if (place == MISS) return;
    if (decision == UNDECIDED || place == UNDECIDED) {
        if (postpone(geometry, primitive)) return;
        uint zeros;
        if (!decide_undecided(GEOMETRY, ray, p0, p1, p2, primitive, hit, 0u, &t_low, &t_high, &zeros)) return;
    }
    hit->t = t_high;
    hit->u = t_low;
    hit->primitive = primitive;
}

// Decides about the triangles that a traversal has postponed. Returns whether one of them is now the hit.
//
// The nearest hit does not depend on the order in which triangles are tested. Of any hits that one is the answer which
// the traversal would have stopped at: a postponed one, if it is hit, because a sure hit ends the traversal.
bool settle_exactly(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    bool found = false;
#ifdef DEFER_UNDECIDED
    const uint count = geometry->undecided->count;
    if (count == 0u) return false;
    geometry->undecided->count = 0u;
    const Hit sure = *hit;
    uint zeros = 0u; // bits of the hit's weights that are surely zero
    if (any_hit) *hit = no_hit_yet(ray);
    for (uint i = 0; i < count && !(any_hit && found); i++) {
        const uint primitive = geometry->undecided->primitives[i];
        if (primitive == hit->primitive) continue;
        const float3 p0 = LOAD_SURFACE_VERTEX(geometry, primitive, 0);
        const float3 p1 = LOAD_SURFACE_VERTEX(geometry, primitive, 1);
        const float3 p2 = LOAD_SURFACE_VERTEX(geometry, primitive, 2);
        float t_low, t_high;
        uint own_zeros;
        if (!decide_undecided(GEOMETRY, ray, p0, p1, p2, primitive, hit, zeros, &t_low, &t_high, &own_zeros)) continue;
        hit->t = t_high;
        hit->u = t_low;
        hit->primitive = primitive;
        zeros = own_zeros;
        found = true;
    }
    if (any_hit && !found) *hit = sure;
#endif
    return found;
}

// t in the caller's units, if it is wanted, and the weights of the triangle that a traversal has found: the floats
// nearest to them. Not a hit's t that is not wanted; the weight of vertex 0 only if it is not the largest one, which
// the others tell.
ONE_COPY SurfaceHit finish_hit(GEOMETRY_PARAMETERS, const Ray* ray, uint primitive, const bool wants_t, float* t) {
    const float3 p0 = LOAD_SURFACE_VERTEX(geometry, primitive, 0);
    const float3 p1 = LOAD_SURFACE_VERTEX(geometry, primitive, 1);
    const float3 p2 = LOAD_SURFACE_VERTEX(geometry, primitive, 2);
    const FinishedHit finished = finish_extended(ray->origin, ray->origin_low, ray->direction, p0, p1, p2, wants_t);
    SurfaceHit hit = {finished.weight0, finished.u, finished.v, primitive};
    bool is_sure = finished.is_sure;
    if (wants_t) {
        *t = callers_t(ray, finished.t);
        is_sure = is_sure && is_normal(*t);
    }
    if (!is_sure) finish_closely(GEOMETRY, ray, p0, p1, p2, wants_t, t, &hit);
    return hit;
}

// Replaces the limits by the floats nearest to t, u and v.
INLINE void finish_exactly(GEOMETRY_PARAMETERS, const Ray* ray, Hit* hit) {
    if (hit->primitive == NO_PRIMITIVE) return;
    const SurfaceHit at = finish_hit(GEOMETRY, ray, hit->primitive, true, &hit->t);
    hit->u = at.u;
    hit->v = at.v;
}

// The same for most hits; false for those that take more precision.
bool finish_mostly_exactly(GEOMETRY_PARAMETERS, const Ray* ray, Hit* hit) {
    const uint primitive = hit->primitive;
    const FinishedHit finished =
        finish_extended(ray->origin, ray->origin_low, ray->direction, LOAD_SURFACE_VERTEX(geometry, primitive, 0),
                        LOAD_SURFACE_VERTEX(geometry, primitive, 1), LOAD_SURFACE_VERTEX(geometry, primitive, 2), true);
    hit->t = callers_t(ray, finished.t);
    hit->u = finished.u;
    hit->v = finished.v;
    return finished.is_sure && is_normal(hit->t);
}

INLINE void surface_exactly(GEOMETRY_PARAMETERS, const Ray* ray, const Hit* hit, SurfaceHit* at) {
    float t;
    *at = finish_hit(GEOMETRY, ray, hit->primitive, false, &t);
}

float error_exactly(float3 p0, float3 p1, float3 p2) { return 0.0f; }

float least_t_exactly(const Hit* hit) { return hit->u; }
