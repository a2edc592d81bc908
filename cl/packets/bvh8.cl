// Packets of sixteen rays, whatever way they go, through the hierarchy of cl/traverse/bvh8.cl: each of a node's eight boxes is tested
// against all of them (group.cl is for those that go one way). Rays that are few in a node go on by themselves, eight boxes or
// triangles at a time: Benthin, Wald, Woop, Ernst and Mark, "Combining Single and Packet-Ray Tracing for Arbitrary Ray Distributions
// on the Intel MIC Architecture", IEEE TVCG 18(9), 2012.
//
// On the bunny 8 nodes a packet of diffuse rays, with 12 rays each.

// Up to so many rays in a node go on by themselves.
#define FEW_RAYS 4u

// What waits on the stack: a child, and when each ray enters it, at infinity if it does not.
typedef struct {
    float16 t_enter;
    uint link;
} PacketChild;

// Which rays enter child `slot` of a node, and when: those that do not, at infinity.
__attribute__((always_inline)) float16 clip_packet(GEOMETRY_PARAMETERS, const RayPacket* p, uint node, uint slot, float16 t_limit) {
    float16 near_x, near_y, near_z, far_x, far_y, far_z;
    if (p->has_one_octant) {
        near_x = (float16)(LOAD_LANE(geometry, node + p->near[0], slot));
        near_y = (float16)(LOAD_LANE(geometry, node + p->near[1], slot));
        near_z = (float16)(LOAD_LANE(geometry, node + p->near[2], slot));
        far_x = (float16)(LOAD_LANE(geometry, node + 2u - p->near[0], slot));
        far_y = (float16)(LOAD_LANE(geometry, node + 10u - p->near[1], slot));
        far_z = (float16)(LOAD_LANE(geometry, node + 18u - p->near[2], slot));
    } else {
        const float16 low_x = (float16)(LOAD_LANE(geometry, node, slot)), high_x = (float16)(LOAD_LANE(geometry, node + 2u, slot));
        const float16 low_y = (float16)(LOAD_LANE(geometry, node + 4u, slot)), high_y = (float16)(LOAD_LANE(geometry, node + 6u, slot));
        const float16 low_z = (float16)(LOAD_LANE(geometry, node + 8u, slot)), high_z = (float16)(LOAD_LANE(geometry, node + 10u, slot));
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

// Tests the eight triangles of a leaf against one ray. *t_limit and *hit_low: limits of the t of its hit, *found the hit's reference.
// False where float32 does not decide.
bool test_alone(GEOMETRY_PARAMETERS, const RayRange* ray, float3 origin_low, float3 direction, float t_near, float t_far, uint skip,
                uint link, float* t_limit, float* hit_low, uint* found) {
    const int4 leaf = leaf_of_link(link);
    const uint first = (uint)leaf.y, count = (uint)leaf.z;
    if (count == 0u) return true;
    LeafTriangles l;
    (void)load_triangles(GEOMETRY, ray, 0, 1u, first / 8u, &l);
    // As from_origin(); the range is of one ray.
    const float8 ax = (l.a[0] - ray->origin_least[0]) - origin_low.x;
    const float8 ay = (l.a[1] - ray->origin_least[1]) - origin_low.y;
    const float8 az = (l.a[2] - ray->origin_least[2]) - origin_low.z;
    const Decision8 d = decide8(ax, ay, az,
                                (float8)(direction.x), (float8)(direction.y), (float8)(direction.z), l.e1[0], l.e1[1], l.e1[2],
                                l.e2[0], l.e2[1], l.e2[2], l.n[0], l.n[1], l.n[2], l.weight_bound, l.det_bound, l.t_bound);
    ulong open = lanes_where8(d.possible) & FIRST_LANES8(count);
    if (open == 0ul) return true;
    open &= ~lanes_where8(d.has_t && (d.t_high < t_near || d.t_low > *t_limit));
    const ulong sure = lanes_where8(d.sure && d.t_low > t_near && d.t_high < t_far);
    for (; open != 0ul; open = other_lanes8(open)) {
        const uint i = first_lane8(open);
        const float t_low = lane_of8(&d.t_low, i), t_high = lane_of8(&d.t_high, i);
        if (LOAD_REFERENCE(geometry, first + i) == skip) continue;
        if (is_lane8(sure, i) && t_low > *t_limit) continue; // behind a hit in this leaf
        if (!is_lane8(sure, i) || !(t_high < *hit_low)) return false;
        *found = first + i;
        *hit_low = t_low;
        *t_limit = t_high;
    }
    return true;
}

// Goes on with one ray of a packet below `link`.
void go_on_alone(GEOMETRY_PARAMETERS, const RayPacket* p, uint lane, uint link, const bool any_hit, float16* t_limits,
                 PacketHits* hits, int16* doubtful) {
    const Slabs slabs = {three_of_lane(p->inv, lane), three_of_lane(p->enter, lane), three_of_lane(p->leave, lane)};
    const uint3 near = near_planes(slabs.inv);
    const float3 origin = three_of_lane(p->origin, lane), direction = three_of_lane(p->direction, lane);
    const float3 origin_low = three_of_lane(p->origin_low, lane);
    const RayRange ray = {{origin.x, origin.y, origin.z}, {origin.x, origin.y, origin.z},
                          {fabs(origin_low.x), fabs(origin_low.y), fabs(origin_low.z)},
                          {fabs(direction.x), fabs(direction.y), fabs(direction.z)}};
    const float t_near = lane_of16(&p->t_near, lane), t_far = lane_of16(&p->t_far, lane);
    const uint skip = ((const uint*)&p->skip)[lane];
    float t_limit = lane_of16(t_limits, lane), hit_low = lane_of16(&hits->t_low, lane);
    uint found = NO_PRIMITIVE;
    bool is_decided = true;

    FarChild stack[STACK_SIZE];
    const FarChild end = {BVH_END, -INFINITY};
    stack[0] = end;
    uint stacked = 0;
    while (link != BVH_END) {
        if ((link & BVH_LEAF) == 0u) {
            link = next_after_node(GEOMETRY, &slabs, near, link, t_near, t_limit, stack, &stacked);
            continue;
        }
        is_decided = test_alone(GEOMETRY, &ray, origin_low, direction, t_near, t_far, skip, link, &t_limit, &hit_low, &found);
        if (!is_decided || (any_hit && found != NO_PRIMITIVE)) break;
        link = next_on_stack(stack, &stacked, t_limit);
    }
    if (!is_decided) ((int*)doubtful)[lane] = -1;
    if (is_decided && found != NO_PRIMITIVE) {
        set_lane16(&hits->t_high, lane, t_limit);
        set_lane16(&hits->t_low, lane, hit_low);
        ((uint*)&hits->reference)[lane] = found;
    }
    const bool is_done = !is_decided || (any_hit && found != NO_PRIMITIVE);
    set_lane16(t_limits, lane, is_done ? -INFINITY : t_limit);
}

// The children of a node that rays enter, in `slots`, the farthest first; when they do in `t_enter`. Returns how many there are.
uint children_of_packet(GEOMETRY_PARAMETERS, const RayPacket* p, uint node, float16 t_limit, uint* slots, float16* t_enter) {
    float order[8];
#pragma unroll
    for (uint slot = 0; slot < 8u; slot++) t_enter[slot] = clip_packet(GEOMETRY, p, node, slot, t_limit);
    const float8 first =
        least_of_lanes(t_enter[0], t_enter[1], t_enter[2], t_enter[3], t_enter[4], t_enter[5], t_enter[6], t_enter[7]);
    vstore8(first, 0, order);
    uint count = 0;
    for (ulong met = lanes_where8(first < INFINITY); met != 0ul; met = other_lanes8(met)) {
        const uint slot = first_lane8(met);
        uint place = count++;
        for (; place > 0u && order[slots[place - 1u]] < order[slot]; place--) slots[place] = slots[place - 1u];
        slots[place] = slot;
    }
    return count;
}

void start_packet(const RayPacket* p, PacketHits* hits, int16* doubtful) {
    hits->t_high = p->t_far;
    hits->t_low = (float16)(INFINITY);
    hits->reference = (uint16)(NO_PRIMITIVE);
    *doubtful = (int16)(0);
}

// The hits of sixteen rays with slabs, of that range, or, with any_hit, some hit of each. Lanes that float32 does not decide are in
// *doubtful, and what is said of their hits means nothing.
void traverse_bvh8_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const RayRange* range, const bool any_hit, PacketHits* hits,
                          int16* doubtful) {
    start_packet(p, hits, doubtful);
    float16 t_limit = p->t_far;

    PacketChild stack[STACK_SIZE];
    stack[0].t_enter = p->t_near;
    stack[0].link = 0u;
    uint stacked = 1;
    while (stacked > 0u) {
        stacked--;
        const int16 is_within = stack[stacked].t_enter <= t_limit;
        const uint link = stack[stacked].link;
        ulong lanes = lanes_where16(is_within);
        if (count_lanes16(lanes) <= FEW_RAYS) {
            for (; lanes != 0ul; lanes = other_lanes8(lanes))
                go_on_alone(GEOMETRY, p, first_lane16(lanes), link, any_hit, &t_limit, hits, doubtful);
            continue;
        }
        if ((link & BVH_LEAF) == 0u) {
            const uint node = BVH8_NODE_RECORDS * link;
            uint slots[8];
            float16 t_enter[8];
            const uint count = children_of_packet(GEOMETRY, p, node, t_limit, slots, t_enter);
            for (uint i = 0; i < count; i++, stacked++) {
                stack[stacked].t_enter = t_enter[slots[i]];
                stack[stacked].link = LOAD_LINK(geometry, node, slots[i]);
            }
        } else {
            const int4 leaf = leaf_of_link(link);
            const uint first = (uint)leaf.y, count = (uint)leaf.z;
            if (count == 0u) continue;
            LeafTriangles triangles;
            (void)load_triangles(GEOMETRY, range, 0, 1u, first / 8u, &triangles);
            for (uint i = 0; i < count; i++)
                (void)test_with_packet(GEOMETRY, p, &triangles, i, first + i, any_hit, &t_limit, hits, doubtful);
        }
    }
}
