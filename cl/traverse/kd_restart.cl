// kd-restart: kd-tree traversal without a stack; after each leaf it starts again at the root.
// Foley and Sugerman, "KD-Tree Acceleration Structures for a GPU Raytracer", Graphics Hardware 2005; thesis, section
// 5.6.1.
//
// Needs a few registers and no private memory. Bad at: steps. Every leaf costs a whole descent, two to three times the
// steps of a stack; on PoCL it has half the speed.
//
// The paper goes on from the t at which the last leaf ended. Here the cells' intervals overlap by their rounding
// errors, so that such a t would find the same leaf again, or, moved on, skip a thin one. What is remembered instead is
// the way:
//
// A branch is a step where the ray meets both children. Bit i of the trail says whether the i-th branch of the way down
// from the root takes the second child (the restart trail of Laine, "Restart Trail for Stackless BVH Traversal", HPG
// 2010, whose one bit a level also marks levels without choice). The same ray makes the same comparisons with the same
// numbers at every descent, whatever they round to, so a trail always leads to the same cell, as a stack entry would.
// `pending` collects the branches that took their first child and whose second one may hold a nearer hit. After a leaf
// the deepest of them is switched to its second child: leaves come in the stack's order, each once, and the trail, read
// as a binary fraction, grows at every restart, so that there are finitely many.

// The trail that leads to the second child of the deepest pending branch.
ulong next_trail(ulong trail, ulong pending) {
    const ulong deepest = (ulong)1 << (63 - clz(pending));
    return (trail & (deepest - 1)) | deepest;
}

bool traverse_kd_restart(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    KdCell root = {0, 0.0f, 0.0f};
    if (!clip_to_box(ray, geometry->low, geometry->high, &root.t_near, &root.t_far)) return false;

    ulong trail = 0;
    while (true) {
        // Descend along the trail, and beyond its end to the first children.
        KdCell cell = root;
        ulong branch = 1;
        ulong pending = 0;
        float t_pending = INFINITY; // the least t_near of a pending child
        int4 node = LOAD_NODE(geometry, 0);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
            KdCell second;
            if (kd_step(ray, node, &cell, &second)) {
                if (trail & branch) {
                    cell = second;
                } else if (!(hit->t < second.t_near)) {
                    pending |= branch;
                    t_pending = min_or(second.t_near, t_pending);
                }
                branch <<= 1;
            }
            node = LOAD_NODE(geometry, cell.node);
        }

        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;

        if (pending == 0 || hit->t < t_pending) return hit->primitive != NO_PRIMITIVE;
        trail = next_trail(trail, pending);
        COUNT(geometry, RESTARTS, 1);
    }
}
