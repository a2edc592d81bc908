// Point queries in a hierarchy of eight children a node (src/accel/bvh8.rs), eight boxes and eight triangles at a time:
// for CPUs, whose vectors one point fills.

// The squares of distances that are no larger than those to the eight boxes of a node, but for 5.1 EPSILON of
// themselves: limit_of() makes up for that.
float8 box_squares(GEOMETRY_PARAMETERS, uint node, const float8* point) {
    float8 outside[3];
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const float8 below = LOAD_EIGHT(geometry, node + 4u * axis) - point[axis];
        const float8 above = point[axis] - LOAD_EIGHT(geometry, node + 4u * axis + 2u);
        outside[axis] = larger8(larger8(below, above), (float8)(0.0f));
    }
    return fma(outside[0], outside[0], fma(outside[1], outside[1], outside[2] * outside[2]));
}

// A corner of each triangle of a packet, from the point as the origin.
Vector8 corner_from(GEOMETRY_PARAMETERS, uint packet, uint corner, const float8* point) {
    const uint record = BVH8_PACKET_RECORDS * packet + 6u * corner;
    const Vector8 from = {LOAD_PACKET(geometry, record) - point[0], LOAD_PACKET(geometry, record + 2u) - point[1],
                          LOAD_PACKET(geometry, record + 4u) - point[2]};
    return from;
}

float least_of_eight(float8 v) {
    const float4 four = v.lo < v.hi ? v.lo : v.hi;
    const float2 two = four.lo < four.hi ? four.lo : four.hi;
    return smaller(two.x, two.y);
}

// As that of binary.cl.
uint visit_triangles(GEOMETRY_PARAMETERS, float3 from, float* distance, __global uint* list, const bool lists) {
    const float8 point[3] = {(float8)(from.x), (float8)(from.y), (float8)(from.z)};
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
            const Vector8 a = corner_from(GEOMETRY, first / 8u, 0u, point);
            const Vector8 b = corner_from(GEOMETRY, first / 8u, 1u, point);
            const Vector8 c = corner_from(GEOMETRY, first / 8u, 2u, point);
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
