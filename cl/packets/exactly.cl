// Exact hits in packets (`exactly` in triangles.cl): eight triangles for decide.cl, what is of the triangles alone; and
// the hits of a packet, of which float32 decides what it is sure of. What it leaves open is put aside.

// In each lane one triangle.
typedef struct {
    float8 a[3]; // the first corners
    DecideTriangle8 rest;
} LeafTriangles_exactly;

// Triangles abc for rays whose magnitudes of decide.cl are no more than these: how far `a` is from their origins, and
// their directions.
void prepare_triangles(const float8* a, const float8* b, const float8* c, const float8* from, const float8* direction,
                       DecideTriangle8* l) {
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        l->e1[axis] = b[axis] - a[axis];
        l->e2[axis] = c[axis] - a[axis];
    }
    l->n[0] = fma(l->e1[1], l->e2[2], -(l->e1[2] * l->e2[1]));
    l->n[1] = fma(l->e1[2], l->e2[0], -(l->e1[0] * l->e2[2]));
    l->n[2] = fma(l->e1[0], l->e2[1], -(l->e1[1] * l->e2[0]));

    const float8 e1x = fabs(l->e1[0]), e1y = fabs(l->e1[1]), e1z = fabs(l->e1[2]);
    const float8 e2x = fabs(l->e2[0]), e2y = fabs(l->e2[1]), e2z = fabs(l->e2[2]);
    const float8 ax = from[0], ay = from[1], az = from[2];
    const float8 dx = direction[0], dy = direction[1], dz = direction[2];
    const float8 px = fma(ay, dz, az * dy), py = fma(az, dx, ax * dz), pz = fma(ax, dy, ay * dx);
    const float8 q = fma(e1x + e2x, px, fma(e1y + e2y, py, (e1z + e2z) * pz)); // Q1 + Q2
    const float8 mx = fma(e1y, e2z, e1z * e2y), my = fma(e1z, e2x, e1x * e2z), mz = fma(e1x, e2y, e1y * e2x);
    const float8 r = fma(mx, dx, fma(my, dy, mz * dz));
    const float8 s = fma(mx, ax, fma(my, ay, mz * az));
    l->weight_bound = fma((float8)(DECIDE_ERROR_WEIGHT), q + r, (float8)(DECIDE_LEAST));
    l->det_bound = fma((float8)(DECIDE_ERROR_DET), r, (float8)(DECIDE_LEAST));
    l->t_bound = fma((float8)(DECIDE_ERROR_T), s, (float8)(DECIDE_LEAST));
}

// As is_in_plane_along(), of eight triangles and all rays of that steepness at most.
ulong parallel_to_rays(const float8* a, const float8* b, const float8* c, float x, float y, float z) {
    if (x != 0.0f && y != 0.0f && z != 0.0f) return 0ul;
    const int8 in_x = a[0] == b[0] && a[0] == c[0], in_y = a[1] == b[1] && a[1] == c[1];
    const int8 in_z = a[2] == b[2] && a[2] == c[2];
    return (x == 0.0f ? lanes_where8(in_x) : 0ul) | (y == 0.0f ? lanes_where8(in_y) : 0ul) |
           (z == 0.0f ? lanes_where8(in_z) : 0ul);
}

float8 farthest8(float8 p, float least, float greatest) { return larger8(fabs(p - least), fabs(p - greatest)); }

// Reads packet number `packet` for rays of that range.
ulong load_triangles_exactly(GEOMETRY_PARAMETERS, const RayRange* range, const Frustum* frusta, uint members,
                             uint packet, LeafTriangles_exactly* l) {
    float8 b[3], c[3];
    load_corners(GEOMETRY, packet, l->a, b, c);
    const float* steepest = range->steepest;
    const ulong parallel = parallel_to_rays(l->a, b, c, steepest[0], steepest[1], steepest[2]);
    const ulong met = met_by_frusta(frusta, members, l->a, b, c) & ~(parallel * 0xfful);
    if (met == 0ul) return met;
    float8 from[3], direction[3];
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        from[axis] = farthest8(l->a[axis], range->origin_least[axis], range->origin_greatest[axis]);
        from[axis] += range->low_most[axis];
        direction[axis] = (float8)(steepest[axis]);
    }
    prepare_triangles(l->a, b, c, from, direction, &l->rest);
    return met;
}

// So many triangles a lane puts aside at most, no more than its ray does then: a lane with more is left to that ray by
// itself. Few lanes put any aside, and lists twice as long cost 2 to 3 % of all rays' time.
#define MOST_ASIDE 8u

// Where each lane surely meets an edge or a vertex, if it is known: the ends of the edge, or twice the vertex. A
// triangle with the same edge or vertex is met there, too, unless the ray is parallel to it.
typedef struct {
    int16 is_known;
    float16 first[3], last[3];
} MetEdges;

// The nearest hit so far of each lane: limits of its t, both t_far where there is none. And what each lane has put
// aside until the traversal is done: the references of triangles that float32 and double do not decide.
typedef struct {
    float16 t_limit; // up to which t a lane looks for a hit: nowhere where that is -infinity
    float16 t_high, t_low;
    uint16 reference, primitive; // NO_PRIMITIVE where there is none
    MetEdges at;                 // where the hit is
    int16 undecided_lanes;
    uint16 postponed; // how many
    uint postponed_references[16][MOST_ASIDE];
} PacketHits_exactly;

void start_packet_exactly(const RayPacket* p, PacketHits_exactly* hits) {
    hits->t_limit = hits->t_high = hits->t_low = p->t_far;
    hits->reference = hits->primitive = (uint16)(NO_PRIMITIVE);
    hits->at.is_known = (int16)(0);
    hits->postponed = (uint16)(0u);
    hits->undecided_lanes = (int16)(0);
}

// Puts a triangle aside for one lane. False if it is one too many.
bool put_aside(uint* postponed, uint* listed, uint reference) {
    if (*postponed == MOST_ASIDE) return false;
    listed[(*postponed)++] = reference;
    return true;
}

// The same; false, too, where nothing is deferred: then settle_lane_exactly() could not decide about it.
bool postpone_for_lane(uint* postponed, uint* listed, uint reference) {
#ifdef DEFER_UNDECIDED
    return put_aside(postponed, listed, reference);
#else
    return false;
#endif
}

// The same for lanes. Those that cannot have it put aside are undecided, and end.
void postpone_for_lanes(PacketHits_exactly* hits, uint reference, int16 is_deferred) {
    for (ulong lanes = lanes_where16(is_deferred); lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        if (postpone_for_lane(&((uint*)&hits->postponed)[lane], hits->postponed_references[lane], reference)) continue;
        set_lane16(&hits->t_limit, lane, -INFINITY);
        ((int*)&hits->undecided_lanes)[lane] = -1;
    }
}

// The lanes, of those that are not undecided, whose answer waits for triangles that are put aside: with any_hit those
// without a hit.
ulong unsettled_lanes_exactly(const PacketHits_exactly* hits, const bool any_hit) {
    const int16 waits = hits->postponed != 0u && !hits->undecided_lanes;
    return lanes_where16(any_hit ? waits && hits->primitive == NO_PRIMITIVE : waits);
}

// Decides about these triangles of one lane, whose ray that is; or, where that takes exact integers, adds it to
// the undecided lanes.
void settle_lane_exactly(GEOMETRY_PARAMETERS, const Ray* ray, uint lane, const bool any_hit, PacketHits_exactly* hits) {
    uint* primitive = &((uint*)&hits->primitive)[lane];
    const uint* listed = hits->postponed_references[lane];
    const uint count = ((const uint*)&hits->postponed)[lane];
    Hit hit = {lane_of16(&hits->t_high, lane), lane_of16(&hits->t_low, lane), 0.0f, *primitive};
#ifdef EXTENDED_IS_DOUBLE
    if (hit.u == AT_START) { // on both sides of 0, as others
        hit.t = next_up(0.0f);
        hit.u = next_down(0.0f);
    }
#endif
    for (uint i = 0; i < count; i++) (void)postpone(geometry, LOAD_REFERENCE(geometry, listed[i]));
    const bool is_other = settle_exactly(GEOMETRY, ray, any_hit, &hit);
    if (FORGET_DEFERRED(geometry)) {
        ((int*)&hits->undecided_lanes)[lane] = -1;
        return;
    }
    if (!is_other) return;
    for (uint i = 0; i < count; i++)
        if (LOAD_REFERENCE(geometry, listed[i]) == hit.primitive)
            ((uint*)&hits->reference)[lane] = listed[i];
    *primitive = hit.primitive;
    set_lane16(&hits->t_high, lane, hit.t);
    set_lane16(&hits->t_low, lane, hit.u);
}

// The lanes of `lanes` that may hit a triangle of that decision within their limits.
int16 open_lanes(const RayPacket* p, const Decision16* d, int16 lanes, float16 t_limit) {
    return lanes && d->possible && !(d->has_t && (d->t_high < p->t_near || d->t_low > t_limit));
}

// Takes a triangle as the hit of those of `open` that surely hit it, and before theirs. Returns the others.
int16 take_sure_hits(const RayPacket* p, const Decision16* d, int16 open, uint reference, uint primitive,
                     const bool any_hit, PacketHits_exactly* hits) {
    const int16 taken = open && d->sure && d->t_low > p->t_near && d->t_high < hits->t_low;
    hits->t_high = taken ? d->t_high : hits->t_high;
    hits->t_low = taken ? d->t_low : hits->t_low;
    hits->reference = taken ? (uint16)(reference) : hits->reference;
    hits->primitive = taken ? (uint16)(primitive) : hits->primitive;
    hits->at.is_known = hits->at.is_known && !taken;
    hits->t_limit = taken ? any_hit ? (float16)(-INFINITY) : d->t_high : hits->t_limit;
    return open && !taken;
}

#ifdef EXTENDED_IS_DOUBLE
#define HALF(vector) (part == 0u ? (vector).lo : (vector).hi)
// decide_closely8(), or decide_closer8() if that is `closer`, for those lanes of a packet whose origins have no second
// part, and that triangle. Half of a packet without any is left out: nothing is possible there.
INLINE void decide_with_doubles(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_exactly* l,
                                uint reference, const int16 lanes, const bool closer, Decision16* result) {
    float8 corners[9]; // read again: nine numbers kept for it make rays at vertices .95 as fast
    const uint record = BVH8_PACKET_RECORDS * (reference / 8u), lane = reference % 8u;
#pragma unroll
    for (uint i = 0; i < 9u; i++) corners[i] = (float8)(LOAD_PACKET_LANE(geometry, record + 2u * i, lane));
    const float8 weight_bound = (float8)(lane_of8(&l->rest.weight_bound, lane));
    const float8 det_bound = (float8)(lane_of8(&l->rest.det_bound, lane));
    const float8 t_bound = (float8)(lane_of8(&l->rest.t_bound, lane));
    Decision8 d[2];
#pragma unroll
    for (uint part = 0; part < 2u; part++) {
        const Decision8 nothing = {(int8)(0), (int8)(0), (int8)(0), (float8)(0.0f), (float8)(0.0f), (int8)(0)};
        d[part] = nothing;
        if (!is_any8(HALF(lanes))) continue;
        const float8 origin[3] = {HALF(p->origin[0]), HALF(p->origin[1]), HALF(p->origin[2])};
        const float8 direction[3] = {HALF(p->direction[0]), HALF(p->direction[1]), HALF(p->direction[2])};
        d[part] = closer ? decide_closer8(origin, direction, corners, weight_bound, det_bound, t_bound)
                         : decide_closely8(origin, direction, corners, weight_bound, det_bound, t_bound, 0);
    }
    result->possible = (int16)(d[0].possible, d[1].possible);
    result->has_t = (int16)(d[0].has_t, d[1].has_t);
    result->sure = (int16)(d[0].sure, d[1].sure);
    result->t_low = (float16)(d[0].t_low, d[1].t_low);
    result->t_high = (float16)(d[0].t_high, d[1].t_high);
    result->zeros = (int16)(d[0].zeros, d[1].zeros);
}
#undef HALF

// Keeps where those of `lanes` meet a triangle of these zero weights, if there are any.
void keep_edges(const int16 zeros, const int16 lanes, const Corners* c, MetEdges* at) {
    const int16 here = lanes && zeros != 0;
    if (!is_any16(here)) return;
    const float p0[3] = {c->p0.x, c->p0.y, c->p0.z}, p1[3] = {c->p1.x, c->p1.y, c->p1.z};
    const float p2[3] = {c->p2.x, c->p2.y, c->p2.z};
    const int16 at0 = (zeros & 1) != 0, at1 = (zeros & 2) != 0, at2 = (zeros & 4) != 0;
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const float16 x0 = (float16)(p0[axis]), x1 = (float16)(p1[axis]), x2 = (float16)(p2[axis]);
        // As first_of_zeros() and last_of_zeros().
        const float16 first = !at0 ? x0 : !at1 ? x1 : x2, last = !at2 ? x2 : !at1 ? x1 : x0;
        at->first[axis] = here ? first : at->first[axis];
        at->last[axis] = here ? last : at->last[axis];
    }
    at->is_known = at->is_known || here;
}

int16 are_at(const float16* points, float3 corner) {
    return points[0] == corner.x && points[1] == corner.y && points[2] == corner.z;
}

// The lanes that meet a triangle of those corners where they meet that edge or vertex, if they are not parallel to it.
int16 meet_same_edges(const MetEdges* at, const Corners* c) {
    const int16 has_first = are_at(at->first, c->p0) || are_at(at->first, c->p1) || are_at(at->first, c->p2);
    const int16 has_last = are_at(at->last, c->p0) || are_at(at->last, c->p1) || are_at(at->last, c->p2);
    return at->is_known && has_first && has_last;
}

// Of hits at the same t that with the lower number is the one.
void take_lower(int16 same, uint reference, uint primitive, PacketHits_exactly* hits) {
    const int16 taken = same && (uint16)(primitive) < hits->primitive;
    hits->reference = taken ? (uint16)(reference) : hits->reference;
    hits->primitive = taken ? (uint16)(primitive) : hits->primitive;
}
#endif

// What becomes of the lanes `open`, for which float32 does not decide about that triangle: the same as of their hit, if
// that is at the same edge or vertex and they surely cross its plane (`crosses`); or twice or four times the precision
// decides; or it is put aside for them.
APART void test_closely(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_exactly* l, uint reference,
                       const bool any_hit, int16 open, const int16 crosses, PacketHits_exactly* hits) {
#ifdef EXTENDED_IS_DOUBLE
    if (!p->has_low) {
        const uint primitive = LOAD_REFERENCE(geometry, reference);
        const Corners corners = corners_of_reference(GEOMETRY, reference);
        const int16 same = open && crosses && meet_same_edges(&hits->at, &corners);
        take_lower(same, reference, primitive, hits);
        open = open && !same;
        int16 asked = open; // those for which more precision is to decide
        for (uint closer = 0; closer < 2u && is_any16(asked); closer++) {
            Decision16 d;
            decide_with_doubles(GEOMETRY, p, l, reference, asked, closer == 1u, &d);
            const int16 met = open_lanes(p, &d, asked, hits->t_limit);
            const int16 left = take_sure_hits(p, &d, met, reference, primitive, any_hit, hits);
            keep_edges(d.zeros, met && !left, &corners, &hits->at);
            // Both where the ray starts.
            const int16 same_start = left && d.sure && d.t_low == AT_START && hits->t_low == AT_START;
            take_lower(same_start, reference, primitive, hits);
            open = (open && !asked) || (left && !same_start);
            // Where the hit is sure, it is open which of two is nearer.
            asked = open && asked && !d.sure && p->skip == NO_PRIMITIVE;
        }
    }
#endif
    postpone_for_lanes(hits, reference, open);
}

// What float32 tells of a packet and the triangle of that reference, one of eight.
INLINE Decision16 decide_triangle(const RayPacket* p, const LeafTriangles_exactly* l, uint reference) {
#define OF_TRIANGLE(member) ((float16)(lane_of8(&l->member, reference % 8u)))
    float16 a[3];
    DecideTriangle16 triangle;
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        a[axis] = from_origins(p, axis, OF_TRIANGLE(a[axis]));
        triangle.e1[axis] = OF_TRIANGLE(rest.e1[axis]);
        triangle.e2[axis] = OF_TRIANGLE(rest.e2[axis]);
        triangle.n[axis] = OF_TRIANGLE(rest.n[axis]);
    }
    triangle.weight_bound = OF_TRIANGLE(rest.weight_bound);
    triangle.det_bound = OF_TRIANGLE(rest.det_bound);
    triangle.t_bound = OF_TRIANGLE(rest.t_bound);
#undef OF_TRIANGLE
    return decide16(a, p->direction, &triangle);
}

// What the triangle of that reference, one of eight, makes of the hits. What float32 does not decide is put aside.
// Whether anything was open.
bool test_with_packet_exactly(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_exactly* l, uint reference,
                              const bool any_hit, PacketHits_exactly* hits) {
    const Decision16 d = decide_triangle(p, l, reference);
    if (!is_any16(d.possible)) return false;
    const uint primitive = LOAD_REFERENCE(geometry, reference);
    // The hit so far may be met again in another leaf.
    const int16 others = p->skip != primitive && hits->primitive != primitive && hits->t_limit >= p->t_near;
    const int16 open = open_lanes(p, &d, others, hits->t_limit);
    const int16 left = take_sure_hits(p, &d, open, reference, primitive, any_hit, hits);
    if (is_any16(left)) test_closely(GEOMETRY, p, l, reference, any_hit, left, d.has_t, hits);
    return is_any16(open);
}
