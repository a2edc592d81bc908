// The hits of rays, the closest first, listed in packets: one work-item lists those of PACKETS_OF_ITEM times sixteen
// rays of the caller's. Its rays meet their hits in any order, and note which they are (cl/packets/counted.cl). Then t,
// u and v of the first hits of sixteen rays are computed at once, of their second ones, and so on, and at last those of
// each ray are sorted.
//
// Nobody knows beforehand how many hits there are, so a packet takes the next places that are free, and tells where
// those of each ray begin. Rays with more than MOST_LISTED hits, that packets do not answer, or for whose hits there is
// no room, are only counted: list_hits.cl lists theirs.

// Where hits are listed.
typedef struct {
    __global uint* starts; // of each ray's: NOT_LISTED if there are none, or they are not listed
    __global Hit* hits;
    volatile __global uint* used; // how many places of `room` are taken, or more
    uint room;
} HitLists;

// The hits of sixteen rays: the first ones of each, the second ones, and so on, in the order in which they were met.
typedef struct {
    const PacketHits* found;
    int16 zeros[MOST_LISTED]; // bits of their weights that are surely zero
} ListedHits;

// Whether a ray hits the triangle of one of a lane's hits before that of another, which have the same t once it is
// rounded: exactly before, or at the same t with a lower number. The hits by their numbers in `listed`.
RARE bool is_exactly_before(GEOMETRY_PARAMETERS, __global const TraceRay* rays, uint index, const ListedHits* listed,
                            uint lane, uint of_hit, uint of_other) {
    const uint reference = ((const uint*)&listed->found->listed[of_hit])[lane];
    const uint other_reference = ((const uint*)&listed->found->listed[of_other])[lane];
    const uint primitive = LOAD_REFERENCE(geometry, reference);
    const uint other = LOAD_REFERENCE(geometry, other_reference);
#ifdef EXTENDED_IS_DOUBLE
    const uint zeros = (uint)((const int*)&listed->zeros[of_hit])[lane];
    if (zeros != 0u) { // most are met at the same vertex or edge
        const Corners p = corners_of_reference(GEOMETRY, reference);
        const Corners q = corners_of_reference(GEOMETRY, other_reference);
        if (zeros_of_same_point(zeros, &p, &q) != 0u) return primitive < other;
    }
#endif
    const Ray ray = batch_ray(rays, index, geometry->scale);
    Hit hit = no_hit_yet(&ray);
    TEST(GEOMETRY, &ray, other, SLOT_OF(other_reference, other), &hit);
    TEST(GEOMETRY, &ray, primitive, SLOT_OF(reference, primitive), &hit);
    return hit.primitive == primitive;
}

// Sorts a ray's hits, the closest first: their numbers, which tell their triangles, and then the hits.
void sort_hits(GEOMETRY_PARAMETERS, const BatchTile* batch, uint index, const ListedHits* listed, uint lane,
               __global Hit* hits) {
    const uint count = ((const uint*)&listed->found->count)[lane];
    Hit met[MOST_LISTED];
    uint numbers[MOST_LISTED];
    bool is_sorted = true;
    for (uint i = 0; i < count; i++) {
        met[i] = hits[i];
        uint place = i;
        for (; place > 0u; place--) {
            const uint other = numbers[place - 1u];
            if (met[i].t > met[other].t) break;
            if (met[i].t == met[other].t && !is_exactly_before(GEOMETRY, batch->rays, index, listed, lane, i, other))
                break;
            numbers[place] = other;
            is_sorted = false;
        }
        numbers[place] = i;
    }
    if (is_sorted) return;
    for (uint i = 0; i < count; i++) hits[i] = met[numbers[i]];
}

// Lists the hits of those lanes of a packet, none of which has more than MOST_LISTED.
void list_packet(GEOMETRY_PARAMETERS, const BatchTile* batch, uint square, const RayPacket* p, float16 t_factor,
                 const PacketHits* found, int16 lanes, const HitLists* lists) {
    const uint16 counts = lanes ? found->count : (uint16)(0u);
    uint starts[16], sum = 0u, most = 0u;
    for (uint lane = 0; lane < 16u; lane++) {
        const uint count = ((const uint*)&counts)[lane];
        starts[lane] = sum;
        sum += count;
        most = max(most, count);
    }
    if (sum == 0u) return;
    const uint begin = atomic_add(lists->used, sum);
    if (begin > lists->room || sum > lists->room - begin) return;
    ListedHits listed;
    listed.found = found;
    ulong sound = lanes_where16(counts != 0u);
    for (uint i = 0; i < most; i++) {
        const int16 is_hit = counts > i;
        uint16 primitives = (uint16)(NO_PRIMITIVE);
        for (ulong open = lanes_where16(is_hit); open != 0ul; open = other_lanes8(open)) {
            const uint lane = first_lane16(open);
            ((uint*)&primitives)[lane] = LOAD_REFERENCE(geometry, ((const uint*)&found->listed[i])[lane]);
        }
        float16 own_t = (float16)(0.0f), u = own_t, v = own_t, fours[4];
        const int16 unsure = finish_hits(GEOMETRY, p, is_hit, found->listed[i], &own_t, &u, &v, &listed.zeros[i]);
        const float16 t = own_t * t_factor;
        hits_of_lanes(t, u, v, primitives, fours);
        // A t that may have lost bits is left to single rays, too.
        const int16 is_exact = own_t == 0.0f || (fabs(t) >= FLT_MIN && fabs(t) <= FLT_MAX);
        const ulong left = lanes_where16(is_hit && (unsure || !is_exact));
        for (ulong open = lanes_where16(is_hit); open != 0ul; open = other_lanes8(open)) {
            const uint lane = first_lane16(open);
            __global Hit* place = lists->hits + begin + starts[lane] + i;
            if ((left & open & (0ul - open)) == 0ul) {
                vstore4(vload4(lane, (const float*)fours), 0, (__global float*)place);
                continue;
            }
            const Ray ray = batch_ray(batch->rays, ray_in_square(batch, square, lane), geometry->scale);
            Hit hit = no_hit();
            hit.primitive = ((const uint*)&primitives)[lane];
            FINISH(GEOMETRY, &ray, &hit);
            *place = hit;
            if (!is_finite(hit.t)) sound &= ~(open & (0ul - open));
        }
    }
    for (; sound != 0ul; sound = other_lanes8(sound)) {
        const uint lane = first_lane16(sound), index = ray_in_square(batch, square, lane);
        sort_hits(GEOMETRY, batch, index, &listed, lane, lists->hits + begin + starts[lane]);
        lists->starts[index] = begin + starts[lane];
    }
}

// How many hits each ray has, up to `most`, and which. MOST_LISTED is less.
__kernel void list_hits_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                                __global uint* restrict counts, __global uint* restrict starts,
                                __global Hit* restrict hits, volatile __global uint* restrict used,
                                ORDER_ARGUMENT const uint most, const uint room, const uint first, const uint end) {
    const uint item = first + 16u * PACKETS_OF_ITEM * (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const BatchTile batch = {rays, sorted, tile_at(item, row, in_bands)};
    prefetch_rays(&batch, item, end);
    CountedTile tile;
    const uint traced = count_tile(GEOMETRY_AT(&geometry), &batch, counts, most, end - item, &tile);
    for (uint i = item; i < min(item + 16u * PACKETS_OF_ITEM, end); i++)
        starts[ray_at(i, row, in_bands, sorted)] = NOT_LISTED;
    const HitLists lists = {starts, hits, used, room};
    for (uint rest = traced; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        list_packet(GEOMETRY_AT(&geometry), &batch, square_in_tile(&batch.tile, k), &tile.packets[k], tile.t_factor[k],
                    &tile.found[k], tile.answered[k] && tile.found[k].count <= MOST_LISTED, &lists);
    }
}
