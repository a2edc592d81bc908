// The single-ray fallback of packets: where few rays of a packet go the same way, each is traced by itself, against
// eight triangles at a time.

typedef struct {
    LaneRay line;
    uint skip;
    // Its hit so far: limits of its t, its reference, but for one that the packet has found, and its triangle.
    float t_limit, hit_low;
    uint found, primitive;
    bool is_at_edge; // whether it is known to be at an edge or a vertex (MetEdges), and at which
    float3 edge_first, edge_last;
    uint postponed; // what it has put aside, as its packet keeps it
    uint* postponed_references;
    bool is_decided; // false if that is too much
} SingleRay_exactly;

SingleRay_exactly take_single_ray_exactly(const RayPacket* p, uint lane, PacketHits_exactly* hits) {
    SingleRay_exactly ray = {ray_of_lane(p, lane),
                             ((const uint*)&p->skip)[lane],
                             lane_of16(&hits->t_limit, lane),
                             lane_of16(&hits->t_low, lane),
                             NO_PRIMITIVE,
                             ((const uint*)&hits->primitive)[lane],
                             ((const int*)&hits->at.is_known)[lane] != 0,
                             (float3)(0.0f),
                             (float3)(0.0f),
                             ((const uint*)&hits->postponed)[lane],
                             hits->postponed_references[lane],
                             true};
    if (ray.is_at_edge) {
        ray.edge_first = three_of_lane(hits->at.first, lane);
        ray.edge_last = three_of_lane(hits->at.last, lane);
    }
    return ray;
}

// Writes what became of it where its packet keeps it. In whole vectors: those are read next, and would wait for a
// single lane.
void put_back_exactly(const SingleRay_exactly* ray, uint lane, const bool any_hit, PacketHits_exactly* hits) {
    ((uint*)&hits->postponed)[lane] = ray->postponed;
    if (ray->is_decided && ray->found == NO_PRIMITIVE) return;
    const int16 here = only_lane16(lane);
    hits->t_limit = here ? (float16)(!ray->is_decided || any_hit ? -INFINITY : ray->t_limit) : hits->t_limit;
    if (!ray->is_decided) {
        hits->undecided_lanes = hits->undecided_lanes || here;
        return;
    }
    hits->t_high = here ? (float16)(ray->t_limit) : hits->t_high;
    hits->t_low = here ? (float16)(ray->hit_low) : hits->t_low;
    hits->reference = here ? (uint16)(ray->found) : hits->reference;
    hits->primitive = here ? (uint16)(ray->primitive) : hits->primitive;
    hits->at.is_known = here ? (int16)(ray->is_at_edge ? -1 : 0) : hits->at.is_known;
    if (!ray->is_at_edge) return;
    set_three_of_lane(hits->at.first, lane, ray->edge_first);
    set_three_of_lane(hits->at.last, lane, ray->edge_last);
}

// The lanes of triangles that a ray may hit within these limits.
ulong open_lanes8(const Decision8* d, float t_near, float t_limit) {
    return lanes_where8(d->possible && !(d->has_t && (d->t_high < t_near || d->t_low > t_limit)));
}

// parallel_to_rays() of one ray and a packet of triangles. A call: it is rare, and the corners are not wanted in
// registers.
APART ulong parallel_to_ray(GEOMETRY_PARAMETERS, float3 direction, uint packet) {
    float8 a[3], b[3], c[3];
    load_corners(GEOMETRY, packet, a, b, c);
    return parallel_to_rays(a, b, c, direction.x, direction.y, direction.z);
}

#ifdef EXTENDED_IS_DOUBLE
// decide_closely8() for one ray and a packet of triangles, or decide_closer8() if that is `closer`. Values instead of a
// pointer to the ray: its address would keep it out of registers.
APART Decision8 decide_with_doubles_alone(GEOMETRY_PARAMETERS, float3 origin, float3 direction, uint packet,
                                         float8 weight_bound, float8 det_bound, float8 t_bound, const bool closer) {
    float8 corners[9];
    load_corners(GEOMETRY, packet, corners, corners + 3, corners + 6);
    const float8 start[3] = {(float8)(origin.x), (float8)(origin.y), (float8)(origin.z)};
    const float8 along[3] = {(float8)(direction.x), (float8)(direction.y), (float8)(direction.z)};
    return closer ? decide_closer8(start, along, corners, weight_bound, det_bound, t_bound)
                  : decide_closely8(start, along, corners, weight_bound, det_bound, t_bound, 0);
}
#endif

// What float32 tells of a ray and a packet of `count` triangles, those of the references from `first` on; where that is
// not sure, what twice the precision does, and then four times, if the ray `starts_free`, on no triangle. Returns the
// lanes of triangles that the ray may hit within those limits.
INLINE ulong decide_packet_of_triangles(GEOMETRY_PARAMETERS, const LaneRay* ray, float t_limit, uint first, uint count,
                                        const bool starts_free, Decision8* d) {
    const float3 origin = ray->origin, low = ray->origin_low, direction = ray->direction;
    LeafTriangles_exactly l;
    float8 b[3], c[3];
    load_corners(GEOMETRY, first / 8u, l.a, b, c);
    const float3 low_size = abs3(low), steepness = abs3(direction);
    const float8 from_x = l.a[0] - origin.x, from_y = l.a[1] - origin.y, from_z = l.a[2] - origin.z;
    const float8 distance[3] = {fabs(from_x) + low_size.x, fabs(from_y) + low_size.y, fabs(from_z) + low_size.z};
    const float8 steepest[3] = {(float8)(steepness.x), (float8)(steepness.y), (float8)(steepness.z)};
    prepare_triangles(l.a, b, c, distance, steepest, &l.rest);
    const float8 a[3] = {from_x - low.x, from_y - low.y, from_z - low.z}; // as from_origin()
    const float8 along[3] = {(float8)(direction.x), (float8)(direction.y), (float8)(direction.z)};
    *d = decide8(a, along, &l.rest);
    ulong open = lanes_where8(d->possible) & FIRST_LANES8(count);
    if (open == 0ul) return 0ul;
    open &= open_lanes8(d, ray->t_near, t_limit);
    if ((open & ~lanes_where8(d->sure)) != 0ul && any(direction == (float3)(0.0f)))
        open &= ~parallel_to_ray(GEOMETRY, direction, first / 8u);
#ifdef EXTENDED_IS_DOUBLE
    if ((open & ~lanes_where8(d->sure)) != 0ul && all(low == (float3)(0.0f))) {
        const uint packet = first / 8u;
        const float8 weight_bound = l.rest.weight_bound, det_bound = l.rest.det_bound, t_bound = l.rest.t_bound;
        *d = decide_with_doubles_alone(GEOMETRY, origin, direction, packet, weight_bound, det_bound, t_bound, false);
        open &= open_lanes8(d, ray->t_near, t_limit);
        if ((open & ~lanes_where8(d->sure)) != 0ul && starts_free) {
            *d = decide_with_doubles_alone(GEOMETRY, origin, direction, packet, weight_bound, det_bound, t_bound, true);
            open &= open_lanes8(d, ray->t_near, t_limit);
        }
    }
#endif
    return open;
}

// Whether a ray meets triangle `i` of that decision surely where it meets its hit: where it starts, or at the same
// vertex or edge. Of the two the lower number is the hit.
APART bool take_tie(GEOMETRY_PARAMETERS, SingleRay_exactly* ray, const Decision8* d, uint i, uint reference,
                   uint primitive) {
#ifdef EXTENDED_IS_DOUBLE
    if (!(((const int*)&d->sure)[i] != 0 && lane_of8(&d->t_low, i) == AT_START && ray->hit_low == AT_START)) {
        if (!ray->is_at_edge || ((const int*)&d->has_t)[i] == 0) return false;
        const Corners corners = corners_of_reference(GEOMETRY, reference);
        if (corners_at(&corners, ray->edge_first) == 0u || corners_at(&corners, ray->edge_last) == 0u) return false;
    }
    if (primitive < ray->primitive) {
        ray->found = reference;
        ray->primitive = primitive;
    }
    return true;
#else
    return false;
#endif
}

// Tests a packet of triangles. What is not decided is put aside. True when nothing more is to be done: too much is put
// aside, or with any_hit there is a hit.
INLINE bool test_single_ray_exactly(GEOMETRY_PARAMETERS, SingleRay_exactly* ray, uint first, uint count,
                                    const bool any_hit) {
    Decision8 d;
    ulong open = decide_packet_of_triangles(GEOMETRY, &ray->line, ray->t_limit, first, count,
                                            ray->skip == NO_PRIMITIVE, &d);
    if (open == 0ul) return false;
    const ulong sure = lanes_where8(d.sure && d.t_low > ray->line.t_near);
    for (; open != 0ul; open = other_lanes8(open)) {
        const uint i = first_lane8(open);
        const float t_low = lane_of8(&d.t_low, i), t_high = lane_of8(&d.t_high, i);
        const uint primitive = LOAD_REFERENCE(geometry, first + i);
        if (primitive == ray->skip || primitive == ray->primitive) continue;
        if (is_lane8(sure, i) && t_low > ray->t_limit) continue; // behind a hit in this packet
        if (!is_lane8(sure, i) || !(t_high < ray->hit_low)) {
            if (take_tie(GEOMETRY, ray, &d, i, first + i, primitive)) continue;
            ray->is_decided = postpone_for_lane(&ray->postponed, ray->postponed_references, first + i);
            if (!ray->is_decided) return true;
            continue;
        }
        ray->found = first + i;
        ray->primitive = primitive;
#ifdef EXTENDED_IS_DOUBLE
        const uint zeros = (uint)((const int*)&d.zeros)[i];
        ray->is_at_edge = zeros != 0u;
        if (zeros != 0u) {
            const Corners corners = corners_of_reference(GEOMETRY, first + i);
            ray->edge_first = first_of_zeros(zeros, &corners);
            ray->edge_last = last_of_zeros(zeros, &corners);
        }
#endif
        ray->hit_low = t_low;
        ray->t_limit = t_high;
    }
    return any_hit && ray->found != NO_PRIMITIVE;
}
