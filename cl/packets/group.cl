// Packets whose rays go much the same way, through the hierarchy of cl/traverse/bvh8.cl together: a node is read once
// for all of them, and of its eight boxes, and of the eight triangles of a leaf, each packet takes those that its
// frustum meets. The rays themselves are asked whether they meet a box only where a frustum tells little: where it is
// broader than the box, and where some rays have not started yet.

// A box is small where the frustum is more than so many times as broad. A quarter and 4 are as fast.
#define BROAD_FRUSTUM 1.0f

// What waits on the stack: a child, which packets meet it, and where it begins (ALONG).
typedef struct {
    uint link, members;
    float nearest;
} GroupChild;

// Of each child of a node the packets of `members` whose frusta meet it: bit k of byte i; of these, in *broad, those of
// which that tells little. Where it begins, in *nearest. `reach`: how far each packet still looks for hits. A line's
// least value within a box is at one of the box's ends along z.
ulong clip_to_frusta(GEOMETRY_PARAMETERS, const Frustum* frusta, uint members, uint node, float4 reach, ulong* broad,
                     float8* nearest) {
    const Frustum* one = &frusta[first_member(members)];
    const uint u = node + 4u * one->u, v = node + 4u * one->v, z = node + 4u * one->z;
    const float8 low_u = LOAD_EIGHT(geometry, u), high_u = LOAD_EIGHT(geometry, u + 2u);
    const float8 low_v = LOAD_EIGHT(geometry, v), high_v = LOAD_EIGHT(geometry, v + 2u);
    const float8 low_z = LOAD_EIGHT(geometry, z), high_z = LOAD_EIGHT(geometry, z + 2u);
    const float8 small_u = BROAD_FRUSTUM * (high_u - low_u), small_v = BROAD_FRUSTUM * (high_v - low_v);
    const float8 first = one->is_upwards ? low_z : -high_z, last = one->is_upwards ? high_z : -low_z;
    // The boxes of children that there are not are upside down.
    const int8 is_there = low_z <= high_z && last >= one->first_start - one->padding,
               is_early = first < one->last_start - one->padding;
    ulong met = 0ul;
    *broad = 0ul;
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        const Frustum* f = &frusta[k];
        const float8 below_u = fma((float8)(f->b[0]), f->b[0] > 0.0f ? low_z : high_z, (float8)(f->a[0]));
        const float8 above_u = fma((float8)(f->b[1]), f->b[1] > 0.0f ? high_z : low_z, (float8)(f->a[1]));
        const float8 below_v = fma((float8)(f->b[2]), f->b[2] > 0.0f ? low_z : high_z, (float8)(f->a[2]));
        const float8 above_v = fma((float8)(f->b[3]), f->b[3] > 0.0f ? high_z : low_z, (float8)(f->a[3]));
        const int8 is_met = is_there && below_u <= high_u && above_u >= low_u && below_v <= high_v &&
                            above_v >= low_v && first <= ((const float*)&reach)[k];
        const int8 is_broad = is_met && (is_early || above_u - below_u > small_u || above_v - below_v > small_v);
        met |= lanes_where8(is_met) << k;
        *broad |= lanes_where8(is_broad) << k;
    }
    *nearest = first;
    return met;
}

// Those of `broad` of which no ray meets the child's box.
ulong missed_by_rays(GEOMETRY_PARAMETERS, RayPacket* packets, const PacketRange* range, uint node, ulong broad,
                     const PacketHits* hits) {
    ulong missed = 0ul;
    for (; broad != 0ul; broad = other_lanes8(broad)) {
        const uint bit = lowest_bit(broad), k = bit % 8u;
        RayPacket* p = &packets[k];
        if (!p->has_slabs) add_slabs(p, range, geometry->low, geometry->high, geometry->near_reach);
        if (!is_any16(clip_packet(GEOMETRY, p, node, bit / 8u, hits[k].t_limit) < INFINITY)) missed |= 1ul << bit;
    }
    return missed;
}

// How far packets still look for hits is one vector: PACKETS_OF_ITEM lanes.
#if PACKETS_OF_ITEM > 4u
#error "members_within() and with_reach() are for up to four packets"
#endif
float4 with_reach(float4 reach, uint k, float along) { return (uint4)(0u, 1u, 2u, 3u) == k ? (float4)(along) : reach; }

// The packets of `members` that reach what begins at `nearest`.
uint members_within(uint members, float nearest, float4 reach) {
    const uint bits = as_uint(convert_char4(nearest <= reach)) & 0x01010101u;
    return members & (bits | bits >> 7 | bits >> 14 | bits >> 21);
}

// Whether a frustum is much broader than the triangles of packet number `packet`: more than BROAD_FOR_LEAVES times as
// large as they would be if all of them were seen from the front (by the sum of their normals' components). Then few of
// its rays meet any of them, and each triangle is tested with all rays. So it is in pictures of few pixels: those of 64
// pixels a side run at 1.6 times the speed (bunny) and 1.5 (gears) without frusta, those of 256 at .97 and .9.
#define BROAD_FOR_LEAVES 2.0f
RARE bool is_broad_for_leaf(GEOMETRY_PARAMETERS, const Frustum* f, uint packet) {
    float8 a[3], b[3], c[3], e1[3], e2[3];
    load_corners(GEOMETRY, packet, a, b, c);
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        e1[axis] = b[axis] - a[axis];
        e2[axis] = c[axis] - a[axis];
    }
    const float8 twice = fabs(e1[1] * e2[2] - e1[2] * e2[1]) + fabs(e1[2] * e2[0] - e1[0] * e2[2]) +
                         fabs(e1[0] * e2[1] - e1[1] * e2[0]);
    const float8 there = twice >= 0.0f ? twice : (float8)(0.0f); // lanes without a triangle are NaN
    const float4 four = there.lo + there.hi;
    const float2 two = four.lo + four.hi;
    const float2 breadth = breadth_of_frustum(f, lane_of8(&a[f->z], 0u));
    return breadth.x * breadth.y > 0.5f * BROAD_FOR_LEAVES * (two.x + two.y);
}

// The hits of the packets of `members`, of that range, as traverse_bvh8_packet() finds them. Their frusta go the same
// way. False if that was given up, with `may_give_up` and before the first triangle was tested (or it would be counted
// twice), because they are too broad for the scene's triangles.
bool traverse_bvh8_group(GEOMETRY_PARAMETERS, RayPacket* packets, const PacketRange* range, const Frustum* frusta,
                         const uint members, const bool any_hit, bool may_give_up, PacketHits* hits) {
    float4 reach = (float4)(-INFINITY);
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        reach = with_reach(reach, k, reach_along(&packets[k], &frusta[k], hits[k].t_limit));
    }

    GroupChild stack[STACK_SIZE];
    uint stacked = 0, link = 0u, open = members;
    while (true) {
        if ((link & BVH_LEAF) == 0u) {
            const uint node = BVH8_NODE_RECORDS * link;
            ulong broad;
            float8 nearest;
            ulong met = clip_to_frusta(GEOMETRY, frusta, open, node, reach, &broad, &nearest);
            met &= ~missed_by_rays(GEOMETRY, packets, range, node, broad, hits);
            if (met != 0ul) { // the most frequent case needs no stack
                const uint slot = first_lane8(met);
                const ulong others = met & ~(0xfful << (8u * slot));
                if (others == 0ul) {
                    link = LOAD_LINK(geometry, node, slot);
                    open = (uint)(met >> (8u * slot));
                    continue;
                }
            }
            const uint lowest = stacked;
            while (met != 0ul) { // the last ones first: the first is best, where any hit will do
                const uint slot = last_lane8(met);
                const GroupChild child = {LOAD_LINK(geometry, node, slot), (uint)(met >> (8u * slot)) & 0xffu,
                                          lane_of8(&nearest, slot)};
                met &= ~(0xfful << (8u * slot));
                uint place = stacked++;
                if (!ANY_ORDER(any_hit))
                    for (; place > lowest && stack[place - 1u].nearest < child.nearest; place--)
                        stack[place] = stack[place - 1u];
                stack[place] = child;
            }
        } else {
            const int4 leaf = leaf_of_link(link);
            const uint first = (uint)leaf.y, count = (uint)leaf.z;
            uint changed = 0u;
            if (count > 0u) {
                LeafTriangles triangles;
                ulong met =
                    load_triangles(GEOMETRY, &range->rays, frusta, open, first / 8u, &triangles) & FIRST_BYTES8(count);
                if (may_give_up && met != 0ul) {
                    may_give_up = false;
                    if (is_broad_for_leaf(GEOMETRY, &frusta[first_member(open)], first / 8u)) return false;
                }
                for (; met != 0ul; met = other_lanes8(met)) {
                    const uint bit = lowest_bit(met), k = bit % 8u, i = bit / 8u;
                    if (test_with_packet(GEOMETRY, &packets[k], &triangles, first + i, any_hit, &hits[k]))
                        changed |= 1u << k;
                }
            }
            for (; changed != 0u; changed &= changed - 1u) {
                const uint k = first_member(changed);
                reach = with_reach(reach, k, reach_along(&packets[k], &frusta[k], hits[k].t_limit));
            }
        }
        do {
            if (stacked == 0u) return true;
            stacked--;
            link = stack[stacked].link;
            open = members_within(stack[stacked].members, stack[stacked].nearest, reach);
        } while (open == 0u);
    }
}

// Whether the first rays of packets do not tell that they have no frusta together: a matter of speed alone.
bool first_rays_go_one_way(const RayPacket* packets, uint members) {
    const RayPacket* p = &packets[first_member(members)];
    const float3 direction = three_of_lane(p->direction, 0u);
    for (uint rest = members & (members - 1u); rest != 0u; rest &= rest - 1u) {
        const float3 other = three_of_lane(packets[first_member(rest)].direction, 0u);
        const float3 product = direction * other;
        if (fmax(product.x, fmax(product.y, product.z)) < 0.25f) return false;
    }
    return true;
}

// Whether the first leaf tells if frusta are too broad. Shadow rays that start on a surface are broad there, and not
// where they go.
bool first_leaf_tells(const RayRange* range, const bool any_hit) {
    const float* least = range->origin_least;
    const float* greatest = range->origin_greatest;
    return !any_hit || (least[0] == greatest[0] && least[1] == greatest[1] && least[2] == greatest[2]);
}

// The hits of the packets of `members` by whatever suits them: together if they all go much the same way, else one by
// one. A packet by itself is faster without a frustum, which tells it little that its rays do not.
void traverse_bvh8_packets(GEOMETRY_PARAMETERS, RayPacket* packets, const uint members, const bool any_hit,
                           PacketHits* hits) {
    PacketRange range;
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        start_packet(&packets[k], &hits[k]);
    }
    const bool are_several = members >> first_member(members) != 1u;
    if (are_several && first_rays_go_one_way(packets, members)) {
        Frustum frusta[PACKETS_OF_ITEM];
        range_of(packets, members, &range);
        // The padding of frusta is for all of the scene, however far out the rest is.
        if (geometry->near_reach == 0.0f &&
            make_frusta(packets, members, &range, geometry->low, geometry->high, frusta) &&
            traverse_bvh8_group(GEOMETRY, packets, &range, frusta, members, any_hit,
                                first_leaf_tells(&range.rays, any_hit), hits))
            return;
    }
    WaitingRays strangers;
    strangers.members = 0u;
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        range_of(packets, 1u << k, &range);
        add_slabs(&packets[k], &range, geometry->low, geometry->high, geometry->near_reach);
        if (!MAY_BE_STRANGERS || !are_strangers(GEOMETRY, &packets[k], &range.rays)) {
            traverse_bvh8_packet(GEOMETRY, &packets[k], &range.rays, any_hit, &hits[k]);
            continue;
        }
        strangers.lanes[k] = lanes_in_root(GEOMETRY, &packets[k], hits[k].t_limit);
        if (strangers.lanes[k] != 0ul) strangers.members |= 1u << k;
    }
    if (MAY_BE_STRANGERS && strangers.members != 0u)
        trace_in_turn(GEOMETRY, packets, &strangers, any_hit, hits);
}
