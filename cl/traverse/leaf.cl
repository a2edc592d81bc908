// What every traversal ends in: the triangles of a leaf, tested one after the other.
//
// Every traversal has the signature
//     bool traverse_…(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit)
// and finds the closest hit of the ray, or with any_hit (a constant at every call, so that inlining folds it away) some hit. *hit
// is written in the ray's own units of t; its primitive is NO_PRIMITIVE on a miss. Returns whether anything was hit.

Hit no_hit(void) {
    const Hit hit = {INFINITY, 0.0f, 0.0f, NO_PRIMITIVE};
    return hit;
}

// is_nearer() with the parameters of is_nearer_exactly(), for triangle tests whose t is as good as it gets.
bool is_nearer_rounded(GEOMETRY_PARAMETERS, const Ray* ray, const Hit* hit, float t, uint primitive, uint slot) {
    return is_nearer(ray, hit, t, primitive);
}

// Tests the triangle of one reference. INTERSECT names the function of cl/intersect/ that was chosen, NEARER the comparison that
// goes with it.
void test_triangle(GEOMETRY_PARAMETERS, const Ray* ray, uint reference, Hit* hit) {
    float t, u, v;
    const uint primitive = LOAD_REFERENCE(geometry, reference);
    if (primitive == ray->skip) return;
    COUNT(geometry, TESTS, 1);
    const uint slot = SLOT_OF(reference, primitive);
    if (!INTERSECT(GEOMETRY, ray, slot, &t, &u, &v)) return;
    if (!NEARER(GEOMETRY, ray, hit, t, primitive, slot)) return;
    hit->t = t;
    hit->u = u;
    hit->v = v;
    hit->primitive = primitive;
}

// Tests the triangles of references first..end. True when that answers the query: any hit will do, and there is one.
bool test_triangles(GEOMETRY_PARAMETERS, const Ray* ray, uint first, uint end, const bool any_hit, Hit* hit) {
    for (uint i = first; i < end; i++) {
        test_triangle(GEOMETRY, ray, i, hit);
        if (any_hit && hit->primitive != NO_PRIMITIVE) return true;
    }
    return false;
}

// The same for the references of a leaf record {KD_LEAF, first, count, _}.
bool test_leaf(GEOMETRY_PARAMETERS, const Ray* ray, int4 leaf, const bool any_hit, Hit* hit) {
    COUNT(geometry, LEAVES, 1);
    COUNT(geometry, EMPTY_LEAVES, leaf.z == 0 ? 1 : 0);
    return test_triangles(GEOMETRY, ray, (uint)leaf.y, (uint)leaf.y + (uint)leaf.z, any_hit, hit);
}
