// Binary bounding volume hierarchy: a node has the boxes of both its children, which are tested together.
// Aila and Laine, "Understanding the Efficiency of Ray Traversal on GPUs", HPG 2009 (the loops are their
// "while-while").
//
// Each triangle is in one leaf, unless splits of space have cut it, and empty space costs nothing but the boxes around
// it: on the bunny half the steps of a kd-tree, and a quarter of its references. Bad at: scenes seen from outside
// through large empty space (sponza: 7.5 steps a camera ray, hardly fewer than the kd-tree's 7.8); large oblique
// triangles among small ones, whose boxes hold much that they do not (--spatial-splits is for these); and the first hit
// need not be the nearest one, because boxes overlap.
//
// nodes: four records each; what they are, and what a link is, src/accel/bvh2.rs says. Boxes have the padding of
// cl/shared/slab.cl, or are tested with a ray's, so that a hit's t is within the computed interval of all boxes above
// it, and a box that is entered after the hit has no nearer one.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // at least the depth of the tree and one; the host knows it
#endif

// Descends to a leaf, nearer children first, or with any_hit child 0, and remembers the links of the others. The link
// of the leaf, or the end. Where they are entered is not remembered: what lies behind a hit by now is looked at all the
// same, a node, a leaf's triangles or an instance, but the stack, which is in memory, is half as large (an H200 traces
// 1.01 to 1.07 times as fast, and scenes/flake.toml's instances as fast). by_bits: see clip_to_pair().
INLINE uint descend_to_leaf(GEOMETRY_PARAMETERS, const PairSlabs* pair, float t_near, float t_limit,
                            const bool by_bits, const bool any_hit, uint* stack, uint* stacked, uint link) {
    while ((link & BVH_LEAF) == 0u) {
        COUNT(geometry, STEPS, 1);
        const uint first = BVH_NODE_RECORDS * link;
        // Read whether it is needed or not: a GPU takes more time for a branch, which rays part at.
        const uint last = stack[*stacked];
        const float4 xy0 = as_float4(LOAD_NODE(geometry, first));
        const float4 xy1 = as_float4(LOAD_NODE(geometry, first + 1u));
        const int4 links = LOAD_NODE(geometry, first + 2u);
        const int4 z1 = LOAD_NODE(geometry, first + 3u);
        const float4 zz = as_float4((int4)(links.zw, z1.xy));
        const float4 t = clip_to_pair(pair, t_near, t_limit, by_bits, xy0, xy1, zz);
        const bool meets0 = t.x <= -t.y, meets1 = t.z <= -t.w;
        const bool goes_to1 = meets1 && (!meets0 || (!any_hit && t.z < t.x));
        const bool goes_back = !(meets0 || meets1);
        link = goes_back ? last : (uint)(goes_to1 ? links.y : links.x);
        if (goes_back) --*stacked;
        if (meets0 && meets1) {
            stack[++*stacked] = (uint)(goes_to1 ? links.x : links.y);
            COUNT_DEEPEST(geometry, *stacked);
        }
    }
    return link;
}

// descend_to_leaf() for rays from far away, which want a padding, and those that look for hits behind their start.
INLINE uint descend_with_padding(GEOMETRY_PARAMETERS, const Ray* ray, float t_limit, const bool any_hit, uint* stack,
                                 uint* stacked, uint link) {
    const Slabs slabs = make_slabs(ray, geometry->low, geometry->high, geometry->near_reach);
    const PairSlabs pair = make_pair_slabs(&slabs);
    return descend_to_leaf(GEOMETRY, &pair, ray->t_near, t_limit, false, any_hit, stack, stacked, link);
}

bool traverse_bvh2(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const bool needs_no_padding =
        is_padding_enough(ray, geometry->low, geometry->high, geometry->near_reach, geometry->padding) &&
        as_int(ray->t_near) >= 0;
    const Slabs slabs = slabs_without_padding(ray);
    const PairSlabs pair = make_pair_slabs(&slabs);

    uint stack[STACK_SIZE];
    stack[0] = BVH_END;
    uint stacked = 0; // apart from the end
    uint link = 0;
    while (true) {
        link = needs_no_padding
                   ? descend_to_leaf(GEOMETRY, &pair, ray->t_near, hit->t, true, any_hit, stack, &stacked, link)
                   : descend_with_padding(GEOMETRY, ray, hit->t, any_hit, stack, &stacked, link);
        if (link == BVH_END) return hit->primitive != NO_PRIMITIVE;

        if (test_leaf(GEOMETRY, ray, leaf_of_link(link), any_hit, hit)) return true;
        link = stack[stacked--];
    }
}
