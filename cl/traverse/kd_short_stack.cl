// Short stack: the far children in a ring of a few entries; when it overflows the oldest is forgotten and found again
// by a restart with push-down.
// Horn, Sugerman, Houston and Hanrahan, "Interactive k-D Tree GPU Raytracing", I3D 2007, section 3.2; thesis, section
// 5.6.1.
//
// Few restarts in little private memory. Bad at: bookkeeping, which a full stack does without; where private memory is
// cheap there is nothing to win. On PoCL 8 entries are as fast as a full stack, 2 cost 15 % and 1 costs 25 % on
// incoherent rays.
//
// The trail and pending branches are those of kd_push_down.cl. The ring holds the second children of the deepest
// pending branches, the newest being the deepest one's: taking it is the same as following the next trail from the
// start.

#ifndef SHORT_STACK_SIZE
#define SHORT_STACK_SIZE 8
#endif

bool traverse_kd_short_stack(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    KdCell start = {0, 0.0f, 0.0f};
    if (!clip_to_box(ray, geometry->low, geometry->high, &start.t_near, &start.t_far)) return false;

    KdCell ring[SHORT_STACK_SIZE];
    uint stored = 0;              // entries in the ring
    uint top = 0;                 // where the next one goes; in a full ring the oldest is there
    float t_forgotten = INFINITY; // the least t_near of an entry that was overwritten since the last restart
    KdCell cell = start;
    ulong trail = 0;
    ulong pending = 0;
    uint branches = 0; // on the way from the start to the cell
    while (true) {
        // Descend to the first leaf, or along the trail.
        int4 node = LOAD_NODE(geometry, cell.node);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
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
                    if (stored == SHORT_STACK_SIZE) {
                        t_forgotten = min_or(ring[top].t_near, t_forgotten);
                        COUNT(geometry, OVERFLOWS, 1);
                    } else {
                        stored++;
                    }
                    ring[top] = second;
                    top = top + 1 == SHORT_STACK_SIZE ? 0 : top + 1;
                }
                branches++;
            }
            node = LOAD_NODE(geometry, cell.node);
        }
        COUNT_DEEPEST(geometry, stored);

        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;

        // Go on with the deepest pending branch.
        do {
            if (pending == 0) return hit->primitive != NO_PRIMITIVE;
            trail = next_trail(trail, pending);
            if (stored == 0) {
                // All that is pending was forgotten: restart.
                if (hit->t < t_forgotten) return hit->primitive != NO_PRIMITIVE;
                COUNT(geometry, RESTARTS, 1);
                t_forgotten = INFINITY;
                cell = start;
                pending = 0;
                branches = 0;
                break;
            }
            branches = 64 - (uint)clz(pending);
            pending &= ~((ulong)1 << (branches - 1));
            stored--;
            top = top == 0 ? SHORT_STACK_SIZE - 1 : top - 1;
            cell = ring[top];
        } while (hit->t < cell.t_near);
    }
}
