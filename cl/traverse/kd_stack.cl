// kd-tree traversal with a full stack of far children.
// Havran, "Heuristic Ray Shooting Algorithms", PhD thesis, Czech Technical University 2000, appendix C; thesis, listing
// 5.2.
//
// No step is repeated, at the price of a stack in private memory (12 bytes a level), which costs registers or local
// memory on a GPU. Differs from the listing where that one loses hits: see kd_step.cl, and thesis_restart.cl for how it
// loses them.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // at least the depth of the tree; the host knows it
#endif

bool traverse_kd_stack(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    KdCell cell = {0, 0.0f, 0.0f};
    if (!clip_to_box(ray, geometry->low, geometry->high, &cell.t_near, &cell.t_far)) return false;

    KdCell stack[STACK_SIZE];
    uint stacked = 0;
    while (true) {
        // Descend to the first leaf of the interval, and remember the far children.
        int4 node = LOAD_NODE(geometry, cell.node);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
            KdCell second;
            if (kd_step(ray, node, &cell, &second)) stack[stacked++] = second;
            node = LOAD_NODE(geometry, cell.node);
        }
        COUNT_DEEPEST(geometry, stacked);

        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;

        // Go on with the nearest remembered cell. One that starts behind the hit cannot hold a nearer one.
        do {
            if (stacked == 0) return hit->primitive != NO_PRIMITIVE;
            cell = stack[--stacked];
        } while (hit->t < cell.t_near);
    }
}
