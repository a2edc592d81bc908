// Point queries in a hierarchy of eight children a node (src/accel/bvh8.rs), eight boxes and eight triangles at a time:
// for CPUs, whose vectors one point fills.

// How far the point is outside of eight boxes along an axis whose planes are the records from `planes` on.
float8 outside_of(GEOMETRY_PARAMETERS, uint planes, float8 point) {
    const float8 below = LOAD_EIGHT(geometry, planes) - point, above = point - LOAD_EIGHT(geometry, planes + 2u);
    return larger8(larger8(below, above), (float8)(0.0f));
}

// The squares of distances that are no larger than those to the eight boxes of a node, but for 5.1 EPSILON of
// themselves: limit_of() makes up for that.
float8 box_squares(GEOMETRY_PARAMETERS, uint node, Vector8 point) {
    const Vector8 outside = {outside_of(GEOMETRY, node, point.x), outside_of(GEOMETRY, node + 4u, point.y),
                             outside_of(GEOMETRY, node + 8u, point.z)};
    return dot_product8(outside, outside);
}

// A corner of each triangle of a packet, from the point as the origin.
Vector8 corner_from(const float8* corner, Vector8 point) {
    const Vector8 at = {corner[0], corner[1], corner[2]};
    return minus8(at, point);
}

float least_of_eight(float8 v) {
    const float4 four = v.lo < v.hi ? v.lo : v.hi;
    const float2 two = four.lo < four.hi ? four.lo : four.hi;
    return smaller(two.x, two.y);
}

// As that of binary.cl.
uint visit_triangles(GEOMETRY_PARAMETERS, float3 from, float* distance, __global uint* list, const bool lists) {
    const Vector8 point = {(float8)(from.x), (float8)(from.y), (float8)(from.z)};
    WideStack stack;
    start_stack(&stack);
    uint stacked = 0u, link = 0u, listed = 0u;
    float limit = limit_of(*distance);
    while (link != BVH_END) {
        if ((link & BVH_LEAF) == 0u) {
            const uint node = BVH8_NODE_RECORDS * link;
            const float8 squares = box_squares(GEOMETRY, node, point);
            link = next_of_children(GEOMETRY, node, squares, squares <= limit, limit, lists, &stack, &stacked);
            continue;
        }
        const uint first = link & BVH_FIRST_MASK, count = (link & ~BVH_LEAF) >> BVH_COUNT_SHIFT;
        if (count > 0u) {
            float8 corners[9];
            load_corners(GEOMETRY, first / 8u, corners, corners + 3, corners + 6);
            const Vector8 a = corner_from(corners, point), b = corner_from(corners + 3, point),
                          c = corner_from(corners + 6, point);
            if (!lists) { // where there are fewer, the last one is there several times
                *distance = smaller(least_of_eight(farthest_distance8(a, b, c)), *distance);
                limit = limit_of(*distance);
            } else {
                ulong within = lanes_where8(may_be_within8(a, b, c, (float8)(*distance))) & FIRST_LANES8(count);
                for (; within != 0ul; within = other_lanes8(within), listed++)
                    if (listed < MOST_CANDIDATES)
                        list[listed] = geometry->references[first + first_lane8(within)];
            }
        }
        link = next_on_stack(GEOMETRY, &stack, &stacked, limit);
    }
    return listed;
}
