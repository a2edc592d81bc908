// What waits while a hierarchy of eight children a node is gone through: children that are farther than others, of
// rays (bvh8.cl) and of points (cl/kernels/closest_point_wide.cl).

#ifndef STACK_SIZE
#define STACK_SIZE 64 // the host knows it
#endif

// A far child, and where the ray enters it.
typedef struct {
    uint link;
    float t_enter;
} FarChild;

// The nearest of what waits on the stack and is not behind the hit, of which the last entry is entered before
// everything.
INLINE uint next_on_stack(const FarChild* stack, uint* stacked, float t_limit) {
    uint top = *stacked;
    while (t_limit < stack[top].t_enter) top--;
    *stacked = top - 1u;
    return stack[top].link;
}

// Puts the nearer of two children first. By selections: nobody can guess which one it is, and a processor that guesses
// wrong loses 20 cycles. Random rays through the bunny run at 1.11 times the speed, through a room at 1.13.
INLINE void order_children(FarChild* first, FarChild* second) {
    const FarChild a = *first, b = *second;
    const bool is_second = b.t_enter < a.t_enter;
    first->link = is_second ? b.link : a.link;
    first->t_enter = is_second ? b.t_enter : a.t_enter;
    second->link = is_second ? a.link : b.link;
    second->t_enter = is_second ? a.t_enter : b.t_enter;
}

// A child of the node `node`: its link, or with by_lane its number in the node.
INLINE FarChild child_of_node(GEOMETRY_PARAMETERS, uint node, uint lane, const float* enter, const bool by_lane) {
    const FarChild child = {by_lane ? lane : LOAD_LINK(geometry, node, lane), enter[lane]};
    return child;
}

// Some children of a node: the three nearest, as far as there are so many, and how many others there are.
typedef struct {
    FarChild nearest, second, third;
    uint others;
    bool has_second, has_third;
} NearChildren;

// Finds the nearest of the children of the node `node` that are met, some; the others are listed in their own order,
// which hardly matters.
INLINE void find_nearest_children(GEOMETRY_PARAMETERS, uint node, ulong met, const float* enter, const bool by_lane,
                                  FarChild* list, NearChildren* n) {
    n->others = 0u;
    n->has_second = n->has_third = false;
    n->nearest = child_of_node(GEOMETRY, node, first_lane8(met), enter, by_lane);
    met = other_lanes8(met);
    if (met == 0ul) return;
    n->has_second = true;
    n->second = child_of_node(GEOMETRY, node, first_lane8(met), enter, by_lane);
    order_children(&n->nearest, &n->second);
    met = other_lanes8(met);
    if (met == 0ul) return;
    n->has_third = true;
    n->third = child_of_node(GEOMETRY, node, first_lane8(met), enter, by_lane);
    order_children(&n->nearest, &n->third);
    order_children(&n->second, &n->third);
    for (met = other_lanes8(met); met != 0ul; met = other_lanes8(met)) {
        FarChild child = child_of_node(GEOMETRY, node, first_lane8(met), enter, by_lane);
        order_children(&n->nearest, &child);
        order_children(&n->second, &child);
        order_children(&n->third, &child);
        list[n->others++] = child;
    }
}

// What comes after the inner node `node`, of whose children a ray meets those of `met` and enters them at `enter`: the
// nearest of them, or with any_hit the last one, while the others wait; or what waited before.
INLINE uint next_of_children(GEOMETRY_PARAMETERS, uint node, ulong met, const float* enter, float t_limit,
                             const bool any_hit, FarChild* stack, uint* stacked) {
    if (met == 0ul) return next_on_stack(stack, stacked, t_limit);
    uint top = *stacked;
    if (any_hit) {
        uint lane = first_lane8(met);
        for (met = other_lanes8(met); met != 0ul; met = other_lanes8(met)) {
            stack[++top] = child_of_node(GEOMETRY, node, lane, enter, false);
            lane = first_lane8(met);
        }
        if (top != *stacked) COUNT_DEEPEST(geometry, top + 1u);
        *stacked = top;
        return LOAD_LINK(geometry, node, lane);
    }
    NearChildren n;
    find_nearest_children(GEOMETRY, node, met, enter, false, stack + top + 1u, &n);
    top += n.others;
    if (n.has_third) stack[++top] = n.third;
    if (n.has_second) {
        stack[++top] = n.second;
        COUNT_DEEPEST(geometry, top + 1u);
    }
    *stacked = top;
    return n.nearest.link;
}
