// Axis-parallel boxes around clusters of triangles, one after the other.
// Thesis, section 2.2.2 (bounding volumes); the idea is that of Rubin and Whitted, "A 3-Dimensional Representation for
// Fast Rendering of Complex Scenes", SIGGRAPH 1980, with one level instead of a hierarchy.
//
// Little memory, each triangle listed once, and no stack: good for a few objects apart from each other. Every ray tests
// every box, so time grows with the square root of the triangles at best, and boxes are not in the order along the ray.
//
// nodes[0] is {0, 1, clusters, 0}; nodes[1 + i] the leaf record of cluster i; bounds[2 i] its box's low corner,
// bounds[2 i + 1] the high one. A box is widened by the ray's own slack (cl/shared/ray.cl), so a hit's t lies between
// the times of entry and exit as computed here, and a box that is entered after the hit has no nearer one.
bool traverse_boxes(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const float slack = SLACK * padding_distance(ray, geometry->low, geometry->high, geometry->near_reach);
    const uint count = (uint)LOAD_NODE(geometry, 0).z;
    for (uint cluster = 0; cluster < count; cluster++) {
        COUNT(geometry, STEPS, 1);
        const float3 low = LOAD_BOUNDS(geometry, 2u * cluster).xyz;
        const float3 high = LOAD_BOUNDS(geometry, 2u * cluster + 1u).xyz;
        float t_near, t_far;
        if (!clip_to_thick_box(ray, slack, low, high, &t_near, &t_far) || hit->t < t_near) continue;
        if (test_leaf(GEOMETRY, ray, LOAD_NODE(geometry, 1u + cluster), any_hit, hit)) return true;
    }
    return hit->primitive != NO_PRIMITIVE;
}
