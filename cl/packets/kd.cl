// Packets of sixteen rays through a kd-tree: one plane is tested against all of them, and every ray keeps the interval
// of its own in the cell. Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray Tracing",
// Eurographics 2001, of which the rays had to go one way along every axis; here each may go its own, and a cell is
// entered as long as some ray is in it. The packets of a work-item go together: a node is read once for all of them,
// and while one packet's comparisons are waited for, others are under way.
//
// Planes are tested as those of boxes, with the padding of cl/shared/slab.cl: a hit's t is within the interval of every
// cell that the hit's point is in. Leaves are packets of triangles as those of cl/traverse/bvh8.cl, several of them
// where a leaf has many triangles.

// A cell, which packets have rays in it, and when each of these enters and leaves it: no ray is in it where that is
// empty.
typedef struct {
    float16 t_near[PACKETS_OF_ITEM], t_far[PACKETS_OF_ITEM];
    uint node, members;
} KdGroupCell;

// Goes on with one ray of a packet in a cell.
void trace_single_ray_in_cell(GEOMETRY_PARAMETERS, const RayPacket* p, uint lane, KdCell cell, const bool any_hit,
                              PacketHits* hits) {
    SingleRay ray = take_single_ray(p, lane, hits);
    const float inv[3] = {ray.line.slabs.inv.x, ray.line.slabs.inv.y, ray.line.slabs.inv.z};
    const float enter[3] = {ray.line.slabs.enter.x, ray.line.slabs.enter.y, ray.line.slabs.enter.z};
    const float leave[3] = {ray.line.slabs.leave.x, ray.line.slabs.leave.y, ray.line.slabs.leave.z};
    KdCell stack[STACK_SIZE];
    uint stacked = 0;
    bool is_done = false;
    while (!is_done) {
        int4 node = LOAD_NODE(geometry, cell.node);
        while ((uint)node.x != KD_LEAF) {
            const uint axis = (uint)node.x;
            const float split = as_float(node.w);
            const float t_low = fma(split, inv[axis], enter[axis]), t_high = fma(split, inv[axis], leave[axis]);
            const uint first = (uint)(inv[axis] >= 0.0f ? node.y : node.z),
                       second = (uint)(inv[axis] >= 0.0f ? node.z : node.y);
            const float first_far = smaller(t_high, cell.t_far), second_near = larger(t_low, cell.t_near);
            const bool meets_second = second_near <= cell.t_far;
            if (cell.t_near <= first_far) {
                if (meets_second) {
                    const KdCell waiting = {second, second_near, cell.t_far};
                    stack[stacked++] = waiting;
                }
                cell.node = first;
                cell.t_far = first_far;
            } else {
                cell.node = second;
                cell.t_near = second_near;
            }
            node = LOAD_NODE(geometry, cell.node);
        }
        const uint first = (uint)node.y, count = (uint)node.z;
        for (uint done = 0; done < count && !is_done; done += 8u)
            is_done = test_single_ray(GEOMETRY, &ray, first + done, min(count - done, 8u), any_hit);
        do {
            if (stacked == 0u) is_done = true;
            else cell = stack[--stacked];
        } while (!is_done && ray.t_limit < cell.t_near);
    }
    put_back(&ray, lane, any_hit, hits);
}

// Where the rays of a packet go on both sides of a plane.
typedef struct {
    float16 first_near, first_far, second_near, second_far;
} KdPacketSplit;

// Which child is on the side of the plane that rays come from, and whether they go several ways along the axis: then it
// is that below the plane. The packets' near planes and mixed axes are those of one range.
typedef struct {
    uint first, second;
    bool is_mixed;
} KdPacketOrder;

KdPacketOrder kd_order(const RayPacket* p, int4 node, uint axis) {
    const bool is_mixed = (p->mixed_axes >> axis & 1u) != 0u, is_down = !is_mixed && p->near[axis] != 4u * axis;
    const KdPacketOrder order = {(uint)(is_down ? node.z : node.y), (uint)(is_down ? node.y : node.z), is_mixed};
    return order;
}

KdPacketSplit kd_packet_split(const RayPacket* p, uint axis, float split, bool is_mixed, float16 t_near,
                              float16 t_far) {
    const float16 inv = p->inv[axis];
    const float16 until = smaller16(fma((float16)(split), inv, p->leave[axis]), t_far);
    const float16 from = larger16(fma((float16)(split), inv, p->enter[axis]), t_near);
    KdPacketSplit s = {t_near, until, from, t_far};
    if (is_mixed) {
        const int16 is_up = inv >= 0.0f;
        s.first_near = is_up ? t_near : from;
        s.first_far = is_up ? until : t_far;
        s.second_near = is_up ? from : t_near;
        s.second_far = is_up ? t_far : until;
    }
    return s;
}

// Goes down from a cell, in which there are rays of packet number k alone, to the first leaf, and puts the cells beyond
// planes on the stack. Where all rays are on one side of a plane, it changes no interval.
int4 descend_with_one(GEOMETRY_PARAMETERS, const RayPacket* packets, uint k, uint from, float16 t_near, float16 t_far,
                      KdGroupCell* stack, uint* stacked) {
    const RayPacket* p = &packets[k];
    KdGroupCell* top = &stack[*stacked];
    int4 node = LOAD_NODE(geometry, from);
    while ((uint)node.x != KD_LEAF) {
        const uint axis = (uint)node.x;
        const KdPacketOrder order = kd_order(p, node, axis);
        const KdPacketSplit s = kd_packet_split(p, axis, as_float(node.w), order.is_mixed, t_near, t_far);
        const bool meets_second = is_any16(s.second_near <= s.second_far);
        uint next = order.second;
        if (is_any16(s.first_near <= s.first_far)) {
            next = order.first;
            if (meets_second) {
                top->t_near[k] = s.second_near;
                top->t_far[k] = s.second_far;
                top->members = 1u << k;
                top->node = order.second;
                top++;
                t_near = s.first_near;
                t_far = s.first_far;
            }
        }
        node = LOAD_NODE(geometry, next);
    }
    *stacked = (uint)(top - stack);
    return node;
}

// The same with the rays of packets of *members, which become those that are in the leaf.
int4 descend_together(GEOMETRY_PARAMETERS, const RayPacket* packets, uint* members, KdGroupCell* cell,
                      KdGroupCell* stack, uint* stacked) {
    const RayPacket* one = &packets[first_member(*members)];
    uint open = *members;
    int4 node = LOAD_NODE(geometry, cell->node);
    while ((uint)node.x != KD_LEAF) {
        const uint axis = (uint)node.x;
        const KdPacketOrder order = kd_order(one, node, axis);
        KdGroupCell* waiting = &stack[*stacked];
        float16 first_near[PACKETS_OF_ITEM], first_far[PACKETS_OF_ITEM];
        int16 meet_first = (int16)(0), meet_second = (int16)(0);
        for (uint rest = open; rest != 0u; rest &= rest - 1u) {
            const uint k = first_member(rest);
            const KdPacketSplit s =
                kd_packet_split(&packets[k], axis, as_float(node.w), order.is_mixed, cell->t_near[k], cell->t_far[k]);
            meet_first = meet_first || s.first_near <= s.first_far;
            meet_second = meet_second || s.second_near <= s.second_far;
            first_near[k] = s.first_near;
            first_far[k] = s.first_far;
            waiting->t_near[k] = s.second_near;
            waiting->t_far[k] = s.second_far;
        }
        const bool goes_to_first = is_any16(meet_first);
        if (goes_to_first && is_any16(meet_second)) {
            uint of_first = 0u, of_second = 0u;
            for (uint rest = open; rest != 0u; rest &= rest - 1u) {
                const uint k = first_member(rest);
                if (is_any16(first_near[k] <= first_far[k])) of_first |= 1u << k;
                if (is_any16(waiting->t_near[k] <= waiting->t_far[k])) of_second |= 1u << k;
                cell->t_near[k] = first_near[k];
                cell->t_far[k] = first_far[k];
            }
            waiting->node = order.second;
            waiting->members = of_second;
            *stacked += 1u;
            open = of_first;
        }
        node = LOAD_NODE(geometry, goes_to_first ? order.first : order.second);
    }
    *members = open;
    return node;
}

// The hits of the packets of `members`, which have slabs and are of that range, as traverse_bvh8_packet() finds them.
// `frusta` leave out triangles: 0 where there are none.
void traverse_kd_group(GEOMETRY_PARAMETERS, const RayPacket* packets, const RayRange* range, const Frustum* frusta,
                       const uint members, const bool any_hit, PacketHits* hits) {
    const float lows[3] = {geometry->low.x, geometry->low.y, geometry->low.z};
    const float highs[3] = {geometry->high.x, geometry->high.y, geometry->high.z};
    KdGroupCell stack[STACK_SIZE];
    stack[0].node = 0u;
    stack[0].members = members;
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        const RayPacket* p = &packets[k];
        start_packet(p, &hits[k]);
        float16 t_near = p->t_near, t_far = p->t_far;
#pragma unroll
        for (uint axis = 0; axis < 3u; axis++) {
            const int16 is_up = p->inv[axis] >= 0.0f;
            const float16 low = (float16)(lows[axis]), high = (float16)(highs[axis]);
            t_near = larger16(t_near, fma(is_up ? low : high, p->inv[axis], p->enter[axis]));
            t_far = smaller16(t_far, fma(is_up ? high : low, p->inv[axis], p->leave[axis]));
        }
        stack[0].t_near[k] = t_near;
        stack[0].t_far[k] = t_far;
    }

    uint stacked = 1u;
    while (stacked > 0u) {
        stacked--;
        const KdGroupCell* cell = &stack[stacked]; // until something else is put there
        ulong lanes[PACKETS_OF_ITEM];
        uint count = 0u, open = 0u;
        for (uint rest = cell->members; rest != 0u; rest &= rest - 1u) {
            const uint k = first_member(rest);
            lanes[k] = lanes_where16(cell->t_near[k] <= smaller16(cell->t_far[k], hits[k].t_limit));
            count += count_lanes16(lanes[k]);
            open |= (lanes[k] != 0ul ? 1u : 0u) << k;
        }
        if (count <= FEW_RAYS) {
            for (; open != 0u; open &= open - 1u) {
                const uint k = first_member(open);
                for (ulong rest = lanes[k]; rest != 0ul; rest = other_lanes8(rest)) {
                    const uint lane = first_lane16(rest);
                    const KdCell of_lane = {cell->node, lane_of16(&cell->t_near[k], lane),
                                            lane_of16(&cell->t_far[k], lane)};
                    trace_single_ray_in_cell(GEOMETRY, &packets[k], lane, of_lane, any_hit, &hits[k]);
                }
            }
            continue;
        }
        int4 leaf;
        const uint one = first_member(open);
        // Not a test of open & (open - 1), of which compilers make the popcount() that Oclgrind does not know.
        if (open >> one == 1u) {
            leaf = descend_with_one(GEOMETRY, packets, one, cell->node, cell->t_near[one],
                                    smaller16(cell->t_far[one], hits[one].t_limit), stack, &stacked);
        } else {
            KdGroupCell from;
            from.node = cell->node;
            for (uint rest = open; rest != 0u; rest &= rest - 1u) {
                const uint k = first_member(rest);
                from.t_near[k] = cell->t_near[k];
                from.t_far[k] = smaller16(cell->t_far[k], hits[k].t_limit);
            }
            leaf = descend_together(GEOMETRY, packets, &open, &from, stack, &stacked);
        }
        const uint first = (uint)leaf.y, triangle_count = (uint)leaf.z;
        for (uint done = 0; done < triangle_count; done += 8u) {
            LeafTriangles triangles;
            const uint here = min(triangle_count - done, 8u);
            ulong met =
                load_triangles(GEOMETRY, range, frusta, open, (first + done) / 8u, &triangles) & FIRST_BYTES8(here);
            for (; met != 0ul; met = other_lanes8(met)) {
                const uint bit = lowest_bit(met), k = bit % 8u, i = bit / 8u;
                (void)test_with_packet(GEOMETRY, &packets[k], &triangles, first + done + i, any_hit, &hits[k]);
            }
        }
    }
}

// As traverse_bvh8_packets(), but all packets go together, whatever way: each step is that of a plane.
void traverse_kd_packets(GEOMETRY_PARAMETERS, RayPacket* packets, const uint members, const bool any_hit,
                         PacketHits* hits) {
    PacketRange range;
    range_of(packets, members, &range);
    Frustum frusta[PACKETS_OF_ITEM];
    const bool has_frusta = make_frusta(packets, members, &range, geometry->low, geometry->high, frusta);
    for (uint rest = members; rest != 0u; rest &= rest - 1u)
        add_slabs(&packets[first_member(rest)], &range, geometry->low, geometry->high, geometry->near_reach);
    traverse_kd_group(GEOMETRY, packets, &range.rays, has_frusta ? frusta : 0, members, any_hit, hits);
}
