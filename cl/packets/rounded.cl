// Hits of packets by a triangle test whose t is as good as it gets (`rounded` in cl/traverse/leaf.cl): the lanes decide
// everything themselves, so nothing is put aside and no lane is undecided.
//
// Which hit a lane gets does not depend on its neighbours where the hits that the test finds lie no farther than
// HIT_ERROR EPSILON D from their triangles (ray.cl). The padding of boxes, planes and frusta is for that: each of these
// triangles is tested as long as no nearer hit is known; and the least t counts, of equal ones the lower number, as
// is_nearer() has it. Every hit of `watertight` lies so. `moller_trumbore` and `plucker` may find hits elsewhere, on
// triangles that are seen edge-on: such a hit a packet may meet and its ray by itself not, or the other way round. The
// packet's hit is then still one that the test finds, and none that lies so is nearer.
#ifdef PACKET_TEST

// The nearest hit so far of each lane; t is t_far where there is none.
typedef struct {
    float16 t_limit; // up to which t a lane looks for a hit: nowhere where that is -infinity
    float16 t, u, v;
    uint16 primitive;
    int16 undecided_lanes; // none
    PacketShears shears;
} PacketHits_rounded;

void start_packet_rounded(const RayPacket* p, PacketHits_rounded* hits) {
    hits->t_limit = hits->t = p->t_far;
    hits->u = hits->v = (float16)(0.0f);
    hits->primitive = (uint16)(NO_PRIMITIVE);
    JOIN(rays_of_, PACKET_TEST)(p, &hits->shears);
    hits->undecided_lanes = (int16)(0);
}

// Reads packet number `packet`.
ulong load_triangles_rounded(GEOMETRY_PARAMETERS, const RayRange* range, const Frustum* frusta, uint members,
                             uint packet, LeafTriangles_rounded* l) {
    load_corners(GEOMETRY, packet, l->corners, l->corners + 3, l->corners + 6);
    const ulong met = met_by_frusta(frusta, members, l->corners, l->corners + 3, l->corners + 6);
    if (met != 0ul) JOIN(triangles_of_, PACKET_TEST)(l);
    return met;
}

bool test_with_packet_rounded(GEOMETRY_PARAMETERS, const RayPacket* p, const LeafTriangles_rounded* l, uint reference,
                              const bool any_hit, PacketHits_rounded* hits) {
    float16 t, u, v;
    const int16 met = JOIN(sixteen_, PACKET_TEST)(p, &hits->shears, l, reference % 8u, &t, &u, &v);
    if (!is_any16(met)) return false;
    const uint primitive = LOAD_REFERENCE(geometry, reference);
    // is_nearer()
    const int16 taken = met && p->skip != primitive && t >= p->t_near &&
                        (t < hits->t_limit || (t == hits->t_limit && primitive < hits->primitive));
    if (!is_any16(taken)) return false;
    hits->t = taken ? t : hits->t;
    hits->u = taken ? u : hits->u;
    hits->v = taken ? v : hits->v;
    hits->primitive = taken ? (uint16)(primitive) : hits->primitive;
    hits->t_limit = taken ? any_hit ? (float16)(-INFINITY) : t : hits->t_limit;
    return true;
}

ulong unsettled_lanes_rounded(const PacketHits_rounded* hits, const bool any_hit) { return 0ul; }
void settle_lane_rounded(GEOMETRY_PARAMETERS, const Ray* ray, uint lane, const bool any_hit, PacketHits_rounded* hits) {
}

int16 finish_packet_rounded(GEOMETRY_PARAMETERS, const RayPacket* p, const PacketHits_rounded* hits, const bool any_hit,
                            FinishedHits* out) {
    const int16 is_hit = hits->primitive != NO_PRIMITIVE;
    out->t = is_hit ? hits->t : (float16)(INFINITY);
    out->u = any_hit ? (float16)(0.0f) : hits->u;
    out->v = any_hit ? (float16)(0.0f) : hits->v;
    out->primitive = hits->primitive;
    return (int16)(0);
}
bool finish_lane_rounded(GEOMETRY_PARAMETERS, const Ray* ray, uint lane, const PacketHits_rounded* hits, Hit* hit) {
    return false;
}

SingleRay_rounded take_single_ray_rounded(const RayPacket* p, uint lane, const PacketHits_rounded* hits) {
    SingleRay_rounded ray;
    ray.line = ray_of_lane(p, lane);
    JOIN(ray_of_, PACKET_TEST)(&hits->shears, lane, &ray.shear);
    ray.skip = ((const uint*)&p->skip)[lane];
    ray.t_limit = lane_of16(&hits->t_limit, lane);
    ray.u = ray.v = 0.0f;
    ray.primitive = ((const uint*)&hits->primitive)[lane];
    ray.is_found = false;
    return ray;
}

// In whole vectors: those are read next, and would wait for a single lane.
void put_back_rounded(const SingleRay_rounded* ray, uint lane, const bool any_hit, PacketHits_rounded* hits) {
    if (!ray->is_found) return;
    const int16 here = only_lane16(lane);
    hits->t_limit = here ? (float16)(any_hit ? -INFINITY : ray->t_limit) : hits->t_limit;
    hits->t = here ? (float16)(ray->t_limit) : hits->t;
    hits->u = here ? (float16)(ray->u) : hits->u;
    hits->v = here ? (float16)(ray->v) : hits->v;
    hits->primitive = here ? (uint16)(ray->primitive) : hits->primitive;
}

// Tests a packet of triangles, those of the references from `first` on. True when nothing more is to be done: with
// any_hit there is a hit.
bool test_single_ray_rounded(GEOMETRY_PARAMETERS, SingleRay_rounded* ray, uint first, uint count, const bool any_hit) {
    LeafTriangles_rounded l;
    load_corners(GEOMETRY, first / 8u, l.corners, l.corners + 3, l.corners + 6);
    JOIN(triangles_of_, PACKET_TEST)(&l);
    float8 t, u, v;
    const int8 met = JOIN(eight_, PACKET_TEST)(ray, &l, &t, &u, &v);
    if (!is_any8(met)) return false;
    ulong open = lanes_where8(met && t >= ray->line.t_near && t <= ray->t_limit) & FIRST_LANES8(count);
    for (; open != 0ul; open = other_lanes8(open)) {
        const uint i = first_lane8(open), primitive = LOAD_REFERENCE(geometry, first + i);
        const float at = lane_of8(&t, i);
        if (primitive == ray->skip || !(at < ray->t_limit || (at == ray->t_limit && primitive < ray->primitive)))
            continue;
        ray->t_limit = at;
        ray->u = lane_of8(&u, i);
        ray->v = lane_of8(&v, i);
        ray->primitive = primitive;
        ray->is_found = true;
    }
    return any_hit && ray->is_found;
}

// What became of rays: the lanes that have hit, and what; those that were traced together.
typedef struct {
    ulong hits, together;
    uint primitive[16];
    float u[16], v[16];
} PacketAnswer_rounded;

void keep_packet_rounded(PacketAnswer_rounded* answer, const PacketHits_rounded* hits) {
    vstore16(hits->primitive, 0, answer->primitive);
    vstore16(hits->u, 0, answer->u);
    vstore16(hits->v, 0, answer->v);
}
void keep_hit_rounded(PacketAnswer_rounded* answer, uint lane, const Hit* hit) {
    answer->primitive[lane] = hit->primitive;
    answer->u[lane] = hit->u;
    answer->v[lane] = hit->v;
}
void hit_of_answer_rounded(const PacketAnswer_rounded* answer, uint lane, Hit* hit) {
    *hit = no_hit();
    hit->primitive = answer->primitive[lane];
    hit->u = answer->u[lane];
    hit->v = answer->v[lane];
}

// As surface_rounded().
int16 weights_of_answer_rounded(const PacketAnswer_rounded* answer, const RayPacket* p, const float16* corners,
                                float16* weight0, float16* u, float16* v) {
    *u = vload16(0, answer->u);
    *v = vload16(0, answer->v);
    const float16 rest = (1.0f - *u) - *v;
    *weight0 = rest < 0.0f ? (float16)(0.0f) : rest;
    return (int16)(-1);
}

// As leave_surface() has it, for make_packet(), which takes it for a t of the direction as it is.
float leaving_t_rounded(float error, float3 direction) {
    return 2.0f * error * power_of_two_scale(max_component(abs3(direction)));
}
#endif
