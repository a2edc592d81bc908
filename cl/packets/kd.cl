// Packets of sixteen rays through a kd-tree: one plane is tested against all of them, and every ray keeps the interval of its own in the
// cell. Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray Tracing", Eurographics 2001, of which the rays
// had to go one way along every axis; here each may go its own, and a cell is entered as long as some ray is in it.
//
// Planes are tested as those of boxes, with the pads of cl/shared/slab.cl: a hit's t is within the interval of every cell that the hit's
// point is in. Leaves are packets of triangles as those of cl/traverse/bvh8.cl, several of them where a leaf has many triangles.

// A cell, and when each ray enters and leaves it: no ray is in it where that is empty.
typedef struct {
    float16 t_near, t_far;
    uint node;
} KdPacketCell;

// Goes on with one ray of a packet in a cell.
void go_on_alone_in_cell(GEOMETRY_PARAMETERS, const RayPacket* p, uint lane, const KdPacketCell* from, const bool any_hit,
                         float16* t_limits, PacketHits* hits, int16* doubtful) {
    LoneRay ray = take_ray(p, lane, t_limits, hits);
    const float inv[3] = {ray.slabs.inv.x, ray.slabs.inv.y, ray.slabs.inv.z};
    const float enter[3] = {ray.slabs.enter.x, ray.slabs.enter.y, ray.slabs.enter.z};
    const float leave[3] = {ray.slabs.leave.x, ray.slabs.leave.y, ray.slabs.leave.z};
    KdCell cell = {from->node, lane_of16(&from->t_near, lane), lane_of16(&from->t_far, lane)};
    KdCell stack[STACK_SIZE];
    uint stacked = 0;
    bool is_done = false;
    while (!is_done) {
        int4 node = LOAD_NODE(geometry, cell.node);
        while ((uint)node.x != KD_LEAF) {
            const uint axis = (uint)node.x;
            const float split = as_float(node.w);
            const float t_low = fma(split, inv[axis], enter[axis]), t_high = fma(split, inv[axis], leave[axis]);
            const uint first = (uint)(inv[axis] >= 0.0f ? node.y : node.z), second = (uint)(inv[axis] >= 0.0f ? node.z : node.y);
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
            is_done = test_alone(GEOMETRY, &ray, first + done, min(count - done, 8u), any_hit);
        do {
            if (stacked == 0u) is_done = true;
            else cell = stack[--stacked];
        } while (!is_done && ray.t_limit < cell.t_near);
    }
    put_back(&ray, lane, any_hit, t_limits, hits, doubtful);
}

// As traverse_bvh8_packet(). `frustum` leaves out triangles: 0 where there is none.
void traverse_kd_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const RayRange* range, const Frustum* frustum, const bool any_hit,
                        PacketHits* hits, int16* doubtful) {
    start_packet(p, hits, doubtful);
    float16 t_limit = p->t_far;
    KdPacketCell cell = {p->t_near, p->t_far, 0u};
    const float lows[3] = {geometry->low.x, geometry->low.y, geometry->low.z};
    const float highs[3] = {geometry->high.x, geometry->high.y, geometry->high.z};
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const int16 is_up = p->inv[axis] >= 0.0f;
        const float16 low = (float16)(lows[axis]), high = (float16)(highs[axis]);
        cell.t_near = larger16(cell.t_near, fma(is_up ? low : high, p->inv[axis], p->enter[axis]));
        cell.t_far = smaller16(cell.t_far, fma(is_up ? high : low, p->inv[axis], p->leave[axis]));
    }

    KdPacketCell stack[STACK_SIZE];
    uint stacked = 0;
    while (true) {
        const ulong lanes = lanes_where16(cell.t_near <= smaller16(cell.t_far, t_limit));
        if (count_lanes16(lanes) <= FEW_RAYS) {
            for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest))
                go_on_alone_in_cell(GEOMETRY, p, first_lane16(rest), &cell, any_hit, &t_limit, hits, doubtful);
        } else {
            cell.t_far = smaller16(cell.t_far, t_limit);
            int4 node = LOAD_NODE(geometry, cell.node);
            while ((uint)node.x != KD_LEAF) {
                const uint axis = (uint)node.x;
                const float16 split = (float16)(as_float(node.w)), inv = p->inv[axis];
                const float16 t_low = fma(split, inv, p->enter[axis]), t_high = fma(split, inv, p->leave[axis]);
                const float16 until = smaller16(t_high, cell.t_far), from = larger16(t_low, cell.t_near);
                // Of the child below the plane, which most rays enter first, unless they go down; and of the one above it.
                KdPacketCell first = {cell.t_near, until, (uint)node.y}, second = {from, cell.t_far, (uint)node.z};
                if ((p->mixed_axes >> axis & 1u) != 0u) {
                    const int16 is_up = inv >= 0.0f;
                    first.t_near = is_up ? cell.t_near : from;
                    first.t_far = is_up ? until : cell.t_far;
                    second.t_near = is_up ? from : cell.t_near;
                    second.t_far = is_up ? cell.t_far : until;
                } else if (p->near[axis] != 4u * axis) {
                    first.node = (uint)node.z;
                    second.node = (uint)node.y;
                }
                const bool meets_second = is_any16(second.t_near <= second.t_far);
                if (is_any16(first.t_near <= first.t_far)) {
                    if (meets_second) stack[stacked++] = second;
                    cell = first;
                } else {
                    cell = second;
                }
                node = LOAD_NODE(geometry, cell.node);
            }
            const uint first = (uint)node.y, count = (uint)node.z;
            for (uint done = 0; done < count; done += 8u) {
                LeafTriangles triangles;
                const uint here = min(count - done, 8u);
                ulong met = load_triangles(GEOMETRY, range, frustum, 1u, (first + done) / 8u, &triangles) & FIRST_LANES8(here);
                for (; met != 0ul; met = other_lanes8(met)) {
                    const uint i = first_lane8(met);
                    (void)test_with_packet(GEOMETRY, p, &triangles, i, first + done + i, any_hit, &t_limit, hits, doubtful);
                }
            }
        }
        if (stacked == 0u) return;
        cell = stack[--stacked];
    }
}

// As traverse_bvh8_packets().
void traverse_kd_packets(GEOMETRY_PARAMETERS, RayPacket* packets, const uint members, const bool any_hit, PacketHits* hits,
                         int16* doubtful) {
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        PacketRange range;
        Frustum frustum;
        range_of(packets, 1u << k, &range);
        add_slabs(&packets[k], &range, geometry->low, geometry->high);
        const bool has_frustum = make_frusta(&packets[k], 1u, &range, geometry->low, geometry->high, &frustum);
        traverse_kd_packet(GEOMETRY, &packets[k], &range.rays, has_frustum ? &frustum : 0, any_hit, &hits[k], &doubtful[k]);
    }
}
