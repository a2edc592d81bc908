// Bounding volume hierarchy of eight children a node, all eight boxes tested at once in vectors, and so are the
// triangles of a leaf. Dammertz, Hanika and Keller, "Shallow Bounding Volume Hierarchies for Fast SIMD Ray Tracing of
// Incoherent Rays", EGSR 2008; Wald, Benthin and Boulos, "Getting Rid of Packets", IEEE Symposium on Interactive Ray
// Tracing 2008.
//
// For CPUs, whose vectors one ray fills: on the bunny 3.9 steps a camera ray, where a binary hierarchy takes 12.8,
// whatever its neighbours do. Bad at: GPUs, where a work-item has one lane and eight boxes take its registers.
//
// nodes: BVH8_NODE_RECORDS records a node; what they are, and what a link is, src/accel/bvh8.rs says. bounds: packets
// of triangles (cl/intersect/filter.cl). Boxes are tested with the padding of cl/shared/slab.cl.

// When the ray enters the boxes of a node, and leaves them.
typedef struct {
    float8 enter, leave;
} Interval8;

// `near`: see near_planes().
Interval8 clip_to_eight(GEOMETRY_PARAMETERS, const Slabs* s, uint3 near, uint node, float t_near, float t_limit) {
    const float8 enter_x = fma(LOAD_EIGHT(geometry, node + near.x), (float8)(s->inv.x), (float8)(s->enter.x));
    const float8 enter_y = fma(LOAD_EIGHT(geometry, node + near.y), (float8)(s->inv.y), (float8)(s->enter.y));
    const float8 enter_z = fma(LOAD_EIGHT(geometry, node + near.z), (float8)(s->inv.z), (float8)(s->enter.z));
    const float8 leave_x = fma(LOAD_EIGHT(geometry, node + 2u - near.x), (float8)(s->inv.x), (float8)(s->leave.x));
    const float8 leave_y = fma(LOAD_EIGHT(geometry, node + 10u - near.y), (float8)(s->inv.y), (float8)(s->leave.y));
    const float8 leave_z = fma(LOAD_EIGHT(geometry, node + 18u - near.z), (float8)(s->inv.z), (float8)(s->leave.z));
    const Interval8 t = {larger8(larger8(enter_x, enter_y), larger8(enter_z, (float8)(t_near))),
                         smaller8(smaller8(leave_x, leave_y), smaller8(leave_z, (float8)(t_limit)))};
    return t;
}

// For each axis the record of a node's planes where a ray enters, from those of the axis on; the others are behind or
// before it.
uint3 near_planes(float3 inv) {
    return (uint3)(inv.x < 0.0f ? 2u : 0u, inv.y < 0.0f ? 6u : 4u, inv.z < 0.0f ? 10u : 8u);
}

// What comes after the inner node `link`, as next_of_children().
INLINE uint next_after_node(GEOMETRY_PARAMETERS, const Slabs* slabs, uint3 near, uint link, float t_near, float t_limit,
                            const bool any_hit, WideStack* stack, uint* stacked) {
    COUNT(geometry, STEPS, 1);
    const uint node = BVH8_NODE_RECORDS * link;
    const Interval8 t = clip_to_eight(GEOMETRY, slabs, near, node, t_near, t_limit);
    return next_of_children(GEOMETRY, node, t.enter, t.enter <= t.leave, t_limit, any_hit, stack, stacked);
}

bool traverse_bvh8(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const Slabs slabs = make_slabs(ray, geometry->low, geometry->high, geometry->near_reach);
    const uint3 near = near_planes(slabs.inv);
    const Filter filter = make_filter(ray);

    WideStack stack;
    start_stack(&stack);
    uint stacked = 0; // apart from the end
    uint link = 0;
    while (link != BVH_END) {
        if ((link & BVH_LEAF) == 0u) {
            link = next_after_node(GEOMETRY, &slabs, near, link, ray->t_near, hit->t, any_hit, &stack, &stacked);
            continue;
        }
        const int4 leaf = leaf_of_link(link);
        const uint first = (uint)leaf.y, count = (uint)leaf.z;
        COUNT(geometry, LEAVES, 1);
        COUNT(geometry, EMPTY_LEAVES, count == 0u ? 1 : 0);
        if (count > 0u) {
            const ulong lanes = FIRST_LANES8(count);
            ulong open = JOIN(filter_, FILTER)(GEOMETRY, &filter, first / 8u) & lanes;
            COUNT(geometry, TESTS, count_lanes8(lanes & ~open));
            for (; open != 0ul; open = other_lanes8(open)) {
                test_triangle(GEOMETRY, ray, first + first_lane8(open), hit);
                if (any_hit && hit->primitive != NO_PRIMITIVE) return true;
            }
        }
        link = next_on_stack(GEOMETRY, &stack, &stacked, hit->t);
    }
    return hit->primitive != NO_PRIMITIVE;
}
