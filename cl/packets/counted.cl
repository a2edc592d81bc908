// Hits that are counted in packets (`counted` in triangles.cl), in hierarchies where each triangle is in one leaf: each
// lane meets it once, in any order, and whether it is hit depends on no other triangle. Float32 and double decide of
// nearly all, as for exact hits (exactly.cl); the others wait until the traversal is done.
//
// With LIST_COUNTED a lane notes which triangles it has counted, the first MOST_LISTED of them.

typedef LeafTriangles_exactly LeafTriangles_counted;
#define load_triangles_counted load_triangles_exactly

// Rays of batches, which leave no triangle.
typedef struct {
    uint most;       // a lane that has counted so many is done: written before a traversal
    float16 t_limit; // up to which t a lane looks for hits: nowhere where that is -infinity
    uint16 count;
    int16 undecided_lanes; // that have too many triangles put aside
    uint16 postponed;      // how many are
    uint postponed_references[16][MOST_ASIDE];
    MetEdges at; // where one of the hits is
#ifdef LIST_COUNTED
    uint16 listed[MOST_LISTED]; // by their references: the first one of each lane, the second one of each, and so on
#endif
} PacketHits_counted;

// Notes the triangle of that reference as number `count` of a lane.
#ifdef LIST_COUNTED
void list_counted(uint16* listed, uint lane, uint count, uint reference) {
    if (count < MOST_LISTED) ((uint*)&listed[count])[lane] = reference;
}
#else
#define list_counted(listed, lane, count, reference)
#endif

void start_packet_counted(const RayPacket* p, PacketHits_counted* hits) {
    hits->t_limit = p->t_far;
    hits->count = hits->postponed = (uint16)(0u);
    hits->undecided_lanes = hits->at.is_known = (int16)(0);
}

// Counts a triangle in these lanes.
void count_lanes(int16 counted, uint reference, PacketHits_counted* hits) {
#ifdef LIST_COUNTED
    for (ulong lanes = lanes_where16(counted); lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        list_counted(hits->listed, lane, ((const uint*)&hits->count)[lane], reference);
    }
#endif
    hits->count += counted ? (uint16)(1u) : (uint16)(0u);
    hits->t_limit = hits->count >= hits->most ? (float16)(-INFINITY) : hits->t_limit;
}

// The lanes of `open` that surely hit a triangle of that decision within their limits.
int16 surely_hit(const RayPacket* p, const Decision16* d, int16 open, const PacketHits_counted* hits) {
    return open && d->sure && d->t_low > p->t_near && d->t_high < hits->t_limit;
}

// As test_closely().
APART void count_closely(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_exactly* l, uint reference,
                        int16 open, const int16 crosses, PacketHits_counted* hits) {
#ifdef EXTENDED_IS_DOUBLE
    if (!p->has_low) {
        const Corners corners = corners_of_reference(GEOMETRY, reference);
        const int16 same = open && crosses && meet_same_edges(&hits->at, &corners);
        count_lanes(same, reference, hits);
        open = open && !same;
        for (uint closer = 0; closer < 2u && is_any16(open); closer++) {
            Decision16 d;
            decide_with_doubles(GEOMETRY, p, l, reference, open, closer == 1u, &d);
            open = open_lanes(p, &d, open, hits->t_limit);
            const int16 sure = surely_hit(p, &d, open, hits);
            keep_edges(d.zeros, sure, &corners, &hits->at);
            count_lanes(sure, reference, hits);
            open = open && !sure;
        }
    }
#endif
    for (ulong lanes = lanes_where16(open); lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        if (put_aside(&((uint*)&hits->postponed)[lane], hits->postponed_references[lane], reference)) continue;
        set_lane16(&hits->t_limit, lane, -INFINITY);
        ((int*)&hits->undecided_lanes)[lane] = -1;
    }
}

bool test_with_packet_counted(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_exactly* l, uint reference,
                              const bool any_hit, PacketHits_counted* hits) {
    const Decision16 d = decide_triangle(p, l, reference);
    if (!is_any16(d.possible)) return false;
    const int16 open = open_lanes(p, &d, hits->t_limit >= p->t_near, hits->t_limit);
    const int16 sure = surely_hit(p, &d, open, hits), left = open && !sure;
    count_lanes(sure, reference, hits);
    if (is_any16(left)) count_closely(GEOMETRY, p, l, reference, left, d.has_t, hits);
    return is_any16(open);
}

typedef struct {
    LaneRay line;
    float t_limit;
    uint count, most;
    uint postponed; // what it has put aside, as its packet keeps it
    uint* postponed_references;
    bool is_decided; // false if that is too much
#ifdef LIST_COUNTED
    uint lane;
    uint16* listed; // as its packet has them
#endif
} SingleRay_counted;

SingleRay_counted take_single_ray_counted(const RayPacket* p, uint lane, PacketHits_counted* hits) {
    SingleRay_counted ray = {ray_of_lane(p, lane),
                             lane_of16(&hits->t_limit, lane),
                             ((const uint*)&hits->count)[lane],
                             hits->most,
                             ((const uint*)&hits->postponed)[lane],
                             hits->postponed_references[lane],
                             true};
#ifdef LIST_COUNTED
    ray.lane = lane;
    ray.listed = hits->listed;
#endif
    return ray;
}

void put_back_counted(const SingleRay_counted* ray, uint lane, const bool any_hit, PacketHits_counted* hits) {
    const int16 here = only_lane16(lane);
    ((uint*)&hits->postponed)[lane] = ray->postponed;
    hits->count = here ? (uint16)(ray->count) : hits->count;
    if (ray->is_decided && ray->count < ray->most) return;
    hits->t_limit = here ? (float16)(-INFINITY) : hits->t_limit;
    if (!ray->is_decided) hits->undecided_lanes = hits->undecided_lanes || here;
}

// True when nothing more is to be done.
INLINE bool test_single_ray_counted(GEOMETRY_PARAMETERS, SingleRay_counted* ray, uint first, uint count,
                                    const bool any_hit) {
    Decision8 d;
    const ulong open = decide_packet_of_triangles(GEOMETRY, &ray->line, ray->t_limit, first, count, true, &d);
    if (open == 0ul) return false;
    const ulong sure = open & lanes_where8(d.sure && d.t_low > ray->line.t_near && d.t_high < ray->t_limit);
#ifdef LIST_COUNTED
    for (ulong lanes = sure; lanes != 0ul; lanes = other_lanes8(lanes))
        list_counted(ray->listed, ray->lane, ray->count++, first + first_lane8(lanes));
#else
    ray->count += count_lanes8(sure);
#endif
    for (ulong left = open & ~sure; left != 0ul; left = other_lanes8(left)) {
        ray->is_decided = put_aside(&ray->postponed, ray->postponed_references, first + first_lane8(left));
        if (!ray->is_decided) return true;
    }
    return ray->count >= ray->most;
}
