// What packets need of the triangle test, which is of one of two kinds as in cl/traverse/leaf.cl, or counts; and the
// triangles of a wide leaf (bvh8.cl), eight at a time.
//
// PACKET_TEST names the test that the lanes do in place of the exact one, of those in rounded_tests.cl. Each kind has
//     LeafTriangles     eight triangles, as far as the test wants them without the rays
//     load_triangles    reads them; returns for each triangle which packets may hit it
//     PacketHits        the nearest hit so far of each lane, up to which t it looks for one (t_limit), the lanes that
//                       the test does not decide (undecided_lanes), and what else it keeps
//     start_packet      no hit yet
//     test_with_packet  what one triangle, by its reference, makes of the hits of sixteen rays; whether they have
//                       changed
//     SingleRay         a ray of a packet that goes on by itself: take_single_ray(), test_single_ray() against eight
//                       triangles, put_back()
// and, unless it counts,
//     unsettled_lanes   the lanes that are not done when the traversal is
//     settle_lane       completes one of them, by its ray
//     finish_packet     the hits as batches want them; the lanes that take more than that
//     finish_lane       the hit of one of these, whose ray that is; whether that did it
//     PacketAnswer      the hits as pictures want them: keep_packet() and keep_hit() write them, hit_of_answer() and
//                       weights_of_answer() read them
//     leaving_t         up to which t a ray that leaves a surface hits nothing (leave_surface() in surface.cl)
// `exactly`: exactly.cl, finish.cl, single_rays.cl. `rounded`: rounded.cl. `counted`: counted.cl.
#if defined(PACKET_TEST)
#define PACKET_HITS rounded
#elif defined(COUNT_HITS)
#define PACKET_HITS counted
#else
#define PACKET_HITS exactly
#endif
// Whether children are met in their own order, which is best for any hit, and not the nearest first.
#ifdef COUNT_HITS
#define ANY_ORDER(any_hit) true // all are met
#else
#define ANY_ORDER(any_hit) (any_hit)
#endif
#define LeafTriangles JOIN(LeafTriangles_, PACKET_HITS)
#define load_triangles JOIN(load_triangles_, PACKET_HITS)
#define PacketHits JOIN(PacketHits_, PACKET_HITS)
#define start_packet JOIN(start_packet_, PACKET_HITS)
#define test_with_packet JOIN(test_with_packet_, PACKET_HITS)
#define unsettled_lanes JOIN(unsettled_lanes_, PACKET_HITS)
#define settle_lane JOIN(settle_lane_, PACKET_HITS)
#define finish_packet JOIN(finish_packet_, PACKET_HITS)
#define finish_lane JOIN(finish_lane_, PACKET_HITS)
#define SingleRay JOIN(SingleRay_, PACKET_HITS)
#define take_single_ray JOIN(take_single_ray_, PACKET_HITS)
#define test_single_ray JOIN(test_single_ray_, PACKET_HITS)
#define put_back JOIN(put_back_, PACKET_HITS)
#define PacketAnswer JOIN(PacketAnswer_, PACKET_HITS)
#define keep_packet JOIN(keep_packet_, PACKET_HITS)
#define keep_hit JOIN(keep_hit_, PACKET_HITS)
#define hit_of_answer JOIN(hit_of_answer_, PACKET_HITS)
#define weights_of_answer JOIN(weights_of_answer_, PACKET_HITS)
#define leaving_t JOIN(leaving_t_, PACKET_HITS)

// Up to so many rays of a packet are traced by themselves where they are.
#define FEW_RAYS 4u

// Hits as the caller of a batch gets them, but for the units of t.
typedef struct {
    float16 t, u, v;
    uint16 primitive;
} FinishedHits;

// For each of eight triangles which of the packets of rays in `members` may hit it, as far as their frusta tell: bit k
// of byte i. Without frusta, which is 0, all.
ulong met_by_frusta(const Frustum* frusta, uint members, const float8* a, const float8* b, const float8* c) {
    ulong met = frusta == 0 ? ALL_LANES8 * members : 0ul;
    for (uint rest = frusta == 0 ? 0u : members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        met |= frustum_meets_triangles(&frusta[k], a, b, c) << k;
    }
    return met;
}
