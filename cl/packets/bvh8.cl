// Packets of sixteen rays, whatever way they go, through the hierarchy of cl/traverse/bvh8.cl: each of a node's eight
// boxes is tested against all of them (group.cl is for those that go one way). Rays that are few in a node are traced
// by themselves, eight boxes or triangles at a time: Benthin, Wald, Woop, Ernst and Mark, "Combining Single and
// Packet-Ray Tracing for Arbitrary Ray Distributions on the Intel MIC Architecture", IEEE TVCG 18(9), 2012. So are
// those that have nothing in common from the first node on, some of them in turn.
//
// On the bunny 8 nodes a packet of diffuse rays, with 12 rays each.

// What waits on the stack: a child, and when each ray enters it, at infinity if it does not.
typedef struct {
    float16 t_enter;
    uint link;
} PacketChild;

// Which rays enter child `slot` of a node, and when: those that do not, at infinity.
INLINE float16 clip_packet(GEOMETRY_PARAMETERS, const RayPacket* p, uint node, uint slot, float16 t_limit) {
    float16 near_x, near_y, near_z, far_x, far_y, far_z;
    if (p->mixed_axes == 0u) {
        near_x = (float16)(LOAD_LANE(geometry, node + p->near[0], slot));
        near_y = (float16)(LOAD_LANE(geometry, node + p->near[1], slot));
        near_z = (float16)(LOAD_LANE(geometry, node + p->near[2], slot));
        far_x = (float16)(LOAD_LANE(geometry, node + 2u - p->near[0], slot));
        far_y = (float16)(LOAD_LANE(geometry, node + 10u - p->near[1], slot));
        far_z = (float16)(LOAD_LANE(geometry, node + 18u - p->near[2], slot));
    } else {
        const float16 low_x = (float16)(LOAD_LANE(geometry, node, slot)),
                      high_x = (float16)(LOAD_LANE(geometry, node + 2u, slot));
        const float16 low_y = (float16)(LOAD_LANE(geometry, node + 4u, slot)),
                      high_y = (float16)(LOAD_LANE(geometry, node + 6u, slot));
        const float16 low_z = (float16)(LOAD_LANE(geometry, node + 8u, slot)),
                      high_z = (float16)(LOAD_LANE(geometry, node + 10u, slot));
        const int16 x = p->inv[0] < 0.0f, y = p->inv[1] < 0.0f, z = p->inv[2] < 0.0f;
        near_x = x ? high_x : low_x;
        near_y = y ? high_y : low_y;
        near_z = z ? high_z : low_z;
        far_x = x ? low_x : high_x;
        far_y = y ? low_y : high_y;
        far_z = z ? low_z : high_z;
    }
    const float16 enter = larger16(larger16(fma(near_x, p->inv[0], p->enter[0]), fma(near_y, p->inv[1], p->enter[1])),
                                   larger16(fma(near_z, p->inv[2], p->enter[2]), p->t_near));
    const float16 leave = smaller16(smaller16(fma(far_x, p->inv[0], p->leave[0]), fma(far_y, p->inv[1], p->leave[1])),
                                   smaller16(fma(far_z, p->inv[2], p->leave[2]), t_limit));
    return enter <= leave ? enter : (float16)(INFINITY);
}

// Goes on with one ray of a packet below `link`.
void trace_single_ray(GEOMETRY_PARAMETERS, const RayPacket* p, uint lane, uint link, const bool any_hit,
                      PacketHits* hits) {
    SingleRay ray = take_single_ray(p, lane, hits);
    const uint3 near = near_planes(ray.line.slabs.inv);
    WideStack stack;
    start_stack(&stack);
    uint stacked = 0;
    while (link != BVH_END) {
        if ((link & BVH_LEAF) == 0u) {
            link = next_after_node(GEOMETRY, &ray.line.slabs, near, link, ray.line.t_near, ray.t_limit,
                                   ANY_ORDER(any_hit), &stack, &stacked);
            continue;
        }
        const int4 leaf = leaf_of_link(link);
        if (leaf.z > 0 && test_single_ray(GEOMETRY, &ray, (uint)leaf.y, (uint)leaf.z, any_hit)) break;
        link = next_on_stack(GEOMETRY, &stack, &stacked, ray.t_limit);
    }
    put_back(&ray, lane, any_hit, hits);
}

// Rays of packets that are traced by themselves, from the root on: those that have not begun.
typedef struct {
    ulong lanes[PACKETS_OF_ITEM];
    uint members; // packets that have some
} WaitingRays;

// So many single rays are traced in turn, a node of each: while one waits for its children others are tested. Of random
// rays through the bunny 2, 4 and 8 in turn run at 1.12, 1.19 and 1.13 times the speed of one.
#define RAYS_IN_TURN_NEARBY 4u

// Where a structure has so many references, most of it is far from a processor's cores. There more rays are traced in
// turn; and whatever a ray comes to, a leaf, too, is asked for, and waits until its next turn. The speed of random rays
// through bumpy spheres, on a Zen 4 and on a Xeon: 82,000 triangles 1.03 and 1.1, 328,000 1.6 and 1.2, 1,311,000 1.9
// (with 4 in turn 1.35) and 1.5; but .97 and .92 with 20,000, which are near.
#ifndef MANY_REFERENCES
#define MANY_REFERENCES (1u << 16)
#endif
#define RAYS_IN_TURN (2u * RAYS_IN_TURN_NEARBY)

// A single ray and where it is, unless its lane is NO_LANE; and what it enters of the inner node there.
#define NO_LANE 16u
typedef struct {
    SingleRay ray;
    uint3 near;
    uint packet, lane, link, stacked;
    float8 enter;
    int8 is_met;
    WideStack stack;
} RayInTurn;

// Begins with the first ray that waits, and takes it from them.
void begin_turn(const RayPacket* packets, WaitingRays* waiting, PacketHits* hits, RayInTurn* r) {
    r->lane = NO_LANE;
    if (waiting->members == 0u) return;
    const uint k = first_member(waiting->members);
    r->packet = k;
    r->lane = first_lane16(waiting->lanes[k]);
    waiting->lanes[k] = other_lanes8(waiting->lanes[k]);
    if (waiting->lanes[k] == 0ul) waiting->members &= waiting->members - 1u;
    r->ray = take_single_ray(&packets[k], r->lane, &hits[k]);
    r->near = near_planes(r->ray.line.slabs.inv);
    r->link = 0u;
    start_stack(&r->stack);
    r->stacked = 0u;
}

// Asks for what is at a link.
void ask_for_link(GEOMETRY_PARAMETERS, uint link) {
    if (link == BVH_END) return;
    if ((link & BVH_LEAF) == 0u) {
        ASK_FOR_NODES(geometry, BVH8_NODE_RECORDS * link, BVH8_NODE_RECORDS);
    } else {
        const uint first = (uint)leaf_of_link(link).y;
        ASK_FOR_BOUNDS(geometry, BVH8_PACKET_RECORDS * (first / 8u), BVH8_PACKET_RECORDS);
        ASK_FOR_REFERENCE(geometry, first);
    }
}

// Takes a ray, which is at a node whose boxes are tested, or at a leaf, to what comes next: a node; or, where leaves
// wait, a leaf. Where it ends another one takes its place.
INLINE void take_turn(GEOMETRY_PARAMETERS, const RayPacket* packets, WaitingRays* waiting, const bool leaves_wait,
                      const bool any_hit, PacketHits* hits, RayInTurn* r) {
    bool is_over = false; // its turn
    if ((r->link & BVH_LEAF) == 0u) {
        r->link = next_of_children(GEOMETRY, BVH8_NODE_RECORDS * r->link, r->enter, r->is_met, r->ray.t_limit,
                                   ANY_ORDER(any_hit), &r->stack, &r->stacked);
        is_over = leaves_wait;
    }
    while (r->lane != NO_LANE && (r->link & BVH_LEAF) != 0u) {
        if (r->link != BVH_END) {
            if (is_over) break;
            const int4 leaf = leaf_of_link(r->link);
            is_over = leaves_wait;
            if (leaf.z == 0 || !test_single_ray(GEOMETRY, &r->ray, (uint)leaf.y, (uint)leaf.z, any_hit)) {
                r->link = next_on_stack(GEOMETRY, &r->stack, &r->stacked, r->ray.t_limit);
                continue;
            }
        }
        put_back(&r->ray, r->lane, any_hit, &hits[r->packet]);
        begin_turn(packets, waiting, hits, r);
    }
    if (leaves_wait && r->lane != NO_LANE) ask_for_link(GEOMETRY, r->link);
}

// Tests the boxes of the nodes where RAYS_IN_TURN_NEARBY rays are. False if none of them goes on.
INLINE bool test_boxes_in_turn(GEOMETRY_PARAMETERS, RayInTurn* rays) {
    bool goes_on = false;
#pragma unroll
    for (uint i = 0; i < RAYS_IN_TURN_NEARBY; i++) {
        RayInTurn* r = &rays[i];
        if (r->lane == NO_LANE) continue;
        goes_on = true;
        if ((r->link & BVH_LEAF) != 0u) continue;
        const Interval8 t = clip_to_eight(GEOMETRY, &r->ray.line.slabs, r->near, BVH8_NODE_RECORDS * r->link,
                                          r->ray.line.t_near, r->ray.t_limit);
        r->enter = t.enter;
        r->is_met = t.enter <= t.leave;
    }
    return goes_on;
}

// Traces rays of packets by themselves.
void trace_in_turn(GEOMETRY_PARAMETERS, const RayPacket* packets, WaitingRays* waiting, const bool any_hit,
                   PacketHits* hits) {
    RayInTurn rays[RAYS_IN_TURN];
    const bool leaves_wait = geometry->reference_count >= MANY_REFERENCES;
    const uint count = leaves_wait ? RAYS_IN_TURN : RAYS_IN_TURN_NEARBY;
    for (uint i = 0; i < count; i++) begin_turn(packets, waiting, hits, &rays[i]);
    while (true) {
        bool goes_on = false;
        for (uint i = 0; i < count; i += RAYS_IN_TURN_NEARBY)
            goes_on |= test_boxes_in_turn(GEOMETRY, rays + i);
        if (!goes_on) return;
        for (uint i = 0; i < count; i++)
            if (rays[i].lane != NO_LANE)
                take_turn(GEOMETRY, packets, waiting, leaves_wait, any_hit, hits, &rays[i]);
    }
}

// The keys of the children of a node that rays enter, as keys_of_children() has them: when the first of them does. In
// `t_enter`, when each does. Returns how many there are.
uint children_of_packet(GEOMETRY_PARAMETERS, const RayPacket* p, uint node, float16 t_limit, const bool any_order,
                        uint* keys, float16* t_enter) {
    // Eight copies are no faster, and a twentieth of what a picture's kernel has for a compiler.
#pragma unroll 2
    for (uint slot = 0; slot < 8u; slot++) t_enter[slot] = clip_packet(GEOMETRY, p, node, slot, t_limit);
    const float8 first =
        least_of_lanes(t_enter[0], t_enter[1], t_enter[2], t_enter[3], t_enter[4], t_enter[5], t_enter[6], t_enter[7]);
    const int8 is_met = first < INFINITY;
    vstore8(keys_of_children(first, is_met, any_order), 0, keys);
    return count_lanes8(lanes_where8(is_met));
}

// Whether rays have so little in common that each is faster by itself: they start far from each other, and on each axis
// some go up and others down. Random rays through the bunny gain a half, of which a quarter is that each meets what is
// near first. Those that start near each other gain by the nodes that all of them meet first: the bunny's diffuse rays
// by 1.44.
//
// No rays of pictures without mirrors and glass are: camera rays have one start, and neighbours' shadow rays near ones.
#define MAY_BE_STRANGERS (HAS(FEATURE_MIRRORS) || HAS(FEATURE_TRANSPARENCY))
#define FAR_STARTS 0.125f // of the scene's size
bool are_strangers(GEOMETRY_PARAMETERS, const RayPacket* p, const RayRange* range) {
    const float3 size = geometry->high - geometry->low;
    const float starts = fmax(range->origin_greatest[0] - range->origin_least[0],
                              fmax(range->origin_greatest[1] - range->origin_least[1],
                                   range->origin_greatest[2] - range->origin_least[2]));
    return p->mixed_axes == 7u && starts > FAR_STARTS * fmax(size.x, fmax(size.y, size.z));
}

// Which rays, of those that are strangers, meet anything of the root.
ulong lanes_in_root(GEOMETRY_PARAMETERS, const RayPacket* p, float16 t_limit) {
    ulong lanes = 0ul;
    for (uint slot = 0; slot < 8u; slot++)
        lanes |= lanes_where16(clip_packet(GEOMETRY, p, 0u, slot, t_limit) < INFINITY);
    return lanes;
}

// The hits of sixteen rays with slabs, of that range, or, with any_hit, some hit of each, where they are nearer than
// those that there are. Triangles that float32 does not decide are put aside (settle_lane), or their lanes are
// undecided, and what is said of these hits means nothing.
void traverse_bvh8_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const RayRange* range, const bool any_hit,
                          PacketHits* hits) {
    PacketChild stack[STACK_SIZE];
    stack[0].t_enter = p->t_near;
    stack[0].link = 0u;
    uint stacked = 1;
    while (stacked > 0u) {
        stacked--;
        const int16 is_within = stack[stacked].t_enter <= hits->t_limit;
        const uint link = stack[stacked].link;
        ulong lanes = lanes_where16(is_within);
        if (count_lanes16(lanes) <= FEW_RAYS) {
            for (; lanes != 0ul; lanes = other_lanes8(lanes))
                trace_single_ray(GEOMETRY, p, first_lane16(lanes), link, any_hit, hits);
            continue;
        }
        if ((link & BVH_LEAF) == 0u) {
            const uint node = BVH8_NODE_RECORDS * link;
            uint keys[8];
            float16 t_enter[8];
            const uint count =
                children_of_packet(GEOMETRY, p, node, hits->t_limit, ANY_ORDER(any_hit), keys, t_enter);
            for (uint i = 0; i < count; i++, stacked++) {
                const uint slot = keys[i] & KEY_LANE;
                stack[stacked].t_enter = t_enter[slot];
                stack[stacked].link = LOAD_LINK(geometry, node, slot);
            }
        } else {
            const int4 leaf = leaf_of_link(link);
            const uint first = (uint)leaf.y, count = (uint)leaf.z;
            if (count == 0u) continue;
            LeafTriangles triangles;
            ulong met = load_triangles(GEOMETRY, range, 0, 1u, first / 8u, &triangles) & FIRST_LANES8(count);
            for (; met != 0ul; met = other_lanes8(met))
                (void)test_with_packet(GEOMETRY, p, &triangles, first + first_lane8(met), any_hit, hits);
        }
    }
}
