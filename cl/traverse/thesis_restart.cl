// kd-restart as the thesis prints it (listing 5.3, with the three cases of listing 5.2), kept to show where it loses
// hits. J. Dvorak, "Streaming Raytracer na GPU", master's thesis, FIT VUT Brno 2008, section 5.6.1.
//
// Bad at: being right. kd_restart.cl is the repaired one. The faults, each asserted by a test:
//  * `t_split < 0` goes to the first child, but the children are ordered by the direction: with the plane behind the
//    origin it is the second one that lies ahead. Hits beyond such planes are lost, most of all those of shadow and
//    secondary rays, which start inside the scene. A zero direction with the origin above the plane (t_split =
//    -infinity) is a case of it.
//  * Zero direction with the origin ON the plane: t_split = 0 / 0 = NaN fails every comparison, becomes t_max, and
//    silently ends the loop.
//  * t_split is not widened by its rounding error: a hit within rounding of a plane is lost when its triangle is on one
//    side only.
// It is slow, too: it does not stop at a hit inside the cell that was searched.

bool traverse_thesis_restart(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    float scene_min, scene_max;
    if (!clip_to_box(ray, geometry->low, geometry->high, &scene_min, &scene_max)) return false;

    float t_max = scene_min;
    while (t_max < scene_max) { // t_max grows at each turn, or the loop ends
        COUNT(geometry, RESTARTS, t_max > scene_min ? 1 : 0);
        const float t_min = t_max;
        t_max = scene_max;
        int4 node = LOAD_NODE(geometry, 0);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
            const uint axis = (uint)node.x;
            const float direction = component(ray->direction, axis);
            const float t_split = (as_float(node.w) - component(ray->origin, axis)) / direction;
            const uint first = (uint)(direction >= 0.0f ? node.y : node.z);
            const uint second = (uint)(direction >= 0.0f ? node.z : node.y);
            uint next = first;
            if (t_split >= t_max || t_split < 0.0f) {
                next = first;
            } else if (t_split <= t_min) {
                next = second;
            } else {
                t_max = t_split;
            }
            node = LOAD_NODE(geometry, next);
        }
        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;
    }
    return hit->primitive != NO_PRIMITIVE;
}
