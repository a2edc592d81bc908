// Every triangle is tested against every ray: the yardstick of all structures (thesis, sections 5.5.2 and 5.6.2), and
// the fastest of them for a few dozen triangles. Bad at everything larger.

bool traverse_brute_force(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    test_triangles(GEOMETRY, ray, 0, geometry->reference_count, any_hit, hit);
    return hit->primitive != NO_PRIMITIVE;
}
