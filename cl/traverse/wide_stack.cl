// What waits while a hierarchy of eight children a node is gone through, by rays (bvh8.cl, cl/packets/bvh8.cl) and by
// points (cl/points/wide.cl): a stack of keys, the nearest on top.
//
// A key is what a float has of when a ray enters a child, but for the last three bits, which are the child's number in
// its node. The eight keys of a node are sorted by a network, in which no step depends on what was compared before:
// nobody can guess which child is nearest, nor how many are entered, and a processor that guesses wrong loses 20
// cycles. Random rays through the bunny and sponza run at 1.23 times the speed that they had when each child was put in
// its place, and those that wait behind a hit were looked at one by one.
// Batcher, "Sorting Networks and Their Applications", AFIPS Spring Joint Computer Conference 1968.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // the host knows it
#endif

// Keys, and the first records of the nodes whose children they are. Below them is the end, eight times: as many are
// looked at together.
#define ENDS 8u
typedef struct {
    uint keys[ENDS + STACK_SIZE], nodes[ENDS + STACK_SIZE];
} WideStack;

// How keys and those `away` become the larger ones of both, or the smaller ones.
#define COMPARE_AWAY(keys, away, is_larger)                            \
    do {                                                               \
        const uint8 others = (keys).away;                              \
        (keys) = (is_larger) ? max(keys, others) : min(keys, others); \
    } while (0)

// The keys of children that are entered at `enter`, where they are met: the largest first, those that are not met last.
// With any_order the larger numbers come first. What is rounded is rounded down.
INLINE uint8 keys_of_children(float8 enter, int8 is_met, const bool any_order) {
    const int8 odd = (int8)(-1, 0, -1, 0, -1, 0, -1, 0), two = (int8)(-1, -1, 0, 0, -1, -1, 0, 0),
               four = (int8)(-1, -1, -1, -1, 0, 0, 0, 0);
    const uint8 bits = as_uint8(enter), rounded = (bits + KEY_LANE * (bits >> 31)) & ~KEY_LANE;
    uint8 keys = (any_order ? (uint8)(FIRST_KEY) : rounded) | (uint8)(0u, 1u, 2u, 3u, 4u, 5u, 6u, 7u);
    keys = is_met != 0 ? keys : (uint8)(0u);
    COMPARE_AWAY(keys, s10325476, odd);
    COMPARE_AWAY(keys, s32107654, two);
    COMPARE_AWAY(keys, s10325476, odd);
    COMPARE_AWAY(keys, s76543210, four);
    COMPARE_AWAY(keys, s23016745, two);
    COMPARE_AWAY(keys, s10325476, odd);
    return keys;
}

void start_stack(WideStack* stack) { vstore8((uint8)(FIRST_KEY), 0, stack->keys); }

// The link of the nearest child that waits and is not entered behind the hit; BVH_END if there is none. Behind a new
// hit are many that wait.
INLINE uint next_on_stack(GEOMETRY_PARAMETERS, const WideStack* stack, uint* stacked, float t_limit) {
    uint top = ENDS - 1u + *stacked;
    if (t_limit < as_float(stack->keys[top] & ~KEY_LANE)) {
        ulong before;
        do {
            top -= 8u;
            before = lanes_where8(!(t_limit < as_float8(vload8(0, stack->keys + top) & ~KEY_LANE)));
        } while (before == 0ul);
        top += last_lane8(before);
    }
    *stacked = top - ENDS; // no number where it is the end, of which nobody asks for the next
    return top < ENDS ? BVH_END : LOAD_LINK(geometry, stack->nodes[top], stack->keys[top] & KEY_LANE);
}

// What comes after the inner node `node`, of whose children a ray meets some and enters them at `enter`: the nearest of
// them, or with any_hit the first one, while the others wait; or what waited before.
INLINE uint next_of_children(GEOMETRY_PARAMETERS, uint node, float8 enter, int8 is_met, float t_limit,
                             const bool any_hit, WideStack* stack, uint* stacked) {
    vstore8(keys_of_children(enter, is_met, any_hit), 0, stack->keys + ENDS + *stacked);
    vstore8((uint8)(node), 0, stack->nodes + ENDS + *stacked);
    *stacked += count_lanes8(lanes_where8(is_met));
    COUNT_DEEPEST(geometry, *stacked);
    return next_on_stack(GEOMETRY, stack, stacked, t_limit);
}
