// kd-restart with push-down: restarts begin at the deepest node that holds everything which is still to be visited.
// Horn, Sugerman, Houston and Hanrahan, "Interactive k-D Tree GPU Raytracing", I3D 2007, section 3.1.
//
// Saves the part of each restart that leads through nodes of which the ray meets one child only, or no other any more;
// four registers dearer than kd_restart.cl, where the trail is explained. Bad at: rays with a pending branch near the
// root, which restart there as before.
//
// A node may become the start when no branch above it is pending. Branches above the start have left the trail: its bit
// 0 is the first branch below the start.

// Looks for nearer hits than *hit in all leaves that the ray meets below `start`. Returns whether *hit is a hit at the
// end.
bool push_down(GEOMETRY_PARAMETERS, const Ray* ray, KdCell start, const bool any_hit, Hit* hit) {
    ulong trail = 0;
    while (true) {
        KdCell cell = start;
        uint branches = 0;
        ulong pending = 0;
        float t_pending = INFINITY; // the least t_near of a pending child
        int4 node = LOAD_NODE(geometry, cell.node);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
            // Push the start down.
            if (pending == 0) {
                start = cell;
                trail >>= branches;
                branches = 0;
            }
            KdCell second;
            if (kd_step(ray, node, &cell, &second)) {
                const ulong branch = (ulong)1 << branches;
                if (trail & branch) {
                    cell = second;
                } else if (!(hit->t < second.t_near)) {
                    pending |= branch;
                    t_pending = min_or(second.t_near, t_pending);
                }
                branches++;
            }
            node = LOAD_NODE(geometry, cell.node);
        }

        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;

        if (pending == 0 || hit->t < t_pending) return hit->primitive != NO_PRIMITIVE;
        trail = next_trail(trail, pending);
        COUNT(geometry, RESTARTS, 1);
    }
}

bool traverse_kd_push_down(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    KdCell root = {0, 0.0f, 0.0f};
    if (!clip_to_box(ray, geometry->low, geometry->high, &root.t_near, &root.t_far)) return false;
    return push_down(GEOMETRY, ray, root, any_hit, hit);
}
