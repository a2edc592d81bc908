// Every triangle is tested against every ray: the yardstick of all structures (thesis, sections 5.5.2 and 5.6.2), and the
// fastest of them for a few dozen triangles.
//
// Every traversal has this signature: finds the closest hit of the ray, or with any_hit (a constant at every call, so that
// inlining folds it away) some hit. *hit is written in the ray's own units of t; its primitive is NO_PRIMITIVE on a miss.
// Returns whether anything was hit.

// Tests one triangle. INTERSECT names the function of cl/intersect/ that was chosen.
void test_triangle(const Geometry* geometry, const Ray* ray, uint primitive, Hit* hit) {
    float t, u, v;
    if (primitive == ray->skip) return;
    if (!INTERSECT(geometry, ray, primitive, &t, &u, &v)) return;
    if (!is_nearer(ray, hit, t, primitive)) return;
    hit->t = t;
    hit->u = u;
    hit->v = v;
    hit->primitive = primitive;
}

Hit no_hit(void) {
    const Hit hit = {INFINITY, 0.0f, 0.0f, NO_PRIMITIVE};
    return hit;
}

bool traverse_brute_force(const Geometry* geometry, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit();
    for (uint i = 0; i < geometry->reference_count; i++) {
        test_triangle(geometry, ray, LOAD_REFERENCE(geometry, i), hit);
        if (any_hit && hit->primitive != NO_PRIMITIVE) return true;
    }
    return hit->primitive != NO_PRIMITIVE;
}
