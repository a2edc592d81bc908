// How many hits rays have, counted in packets: one work-item counts those of PACKETS_OF_ITEM times sixteen rays of the
// caller's. The answers are those of count_hits.cl, which counts what packets do not answer.

// Counts the hits of a lane's triangles that are put aside, by its ray.
RARE uint count_postponed(GEOMETRY_PARAMETERS, Ray* ray, uint lane, const PacketHits* hits) {
    ray->most = 0u;
    Hit counted = no_hit();
    for (uint i = 0; i < ((const uint*)&hits->postponed)[lane]; i++)
        test_triangle(GEOMETRY, ray, hits->postponed_references[lane][i], &counted);
    return counted_hits(&counted);
}

// Counts the hits of packets of sixteen rays each together, those of `full` (bits). Writes to `answered` the lanes that
// have their counts.
void count_together(GEOMETRY_PARAMETERS, const BatchTile* batch, __global uint* counts, const uint most,
                    const uint full, int16* answered) {
    RayPacket packets[PACKETS_OF_ITEM];
    PacketHits found[PACKETS_OF_ITEM];
    uint traced = 0u;
    for (uint rest = full; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        float16 t_factor;
        answered[k] = load_packet(batch, square_in_tile(&batch->tile, k), geometry->scale, &packets[k], &t_factor);
        found[k].most = most;
        if (is_any16(answered[k])) traced |= 1u << k;
    }
    if (traced == 0u) return;
    TRAVERSE_PACKETS(GEOMETRY, packets, traced, false, found);
    for (; traced != 0u; traced &= traced - 1u) {
        const uint k = first_member(traced), square = square_in_tile(&batch->tile, k);
        answered[k] = answered[k] && !found[k].undecided_lanes;
        for (ulong open = lanes_where16(answered[k] && found[k].postponed != 0u); open != 0ul;
             open = other_lanes8(open)) {
            const uint lane = first_lane16(open);
            Ray ray = batch_ray(batch->rays, ray_in_square(batch, square, lane), geometry->scale);
            ((uint*)&found[k].count)[lane] += count_postponed(GEOMETRY, &ray, lane, &found[k]);
        }
        const uint16 count = min(found[k].count, most);
        for (uint lane = 0; lane < 16u; lane++)
            counts[ray_in_square(batch, square, lane)] = ((const uint*)&count)[lane];
    }
}

// How many hits each ray has, up to `most`.
__kernel void count_hits_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                                 __global uint* restrict counts, ORDER_ARGUMENT const uint most, const uint first,
                                 const uint end) {
    const uint item = first + 16u * PACKETS_OF_ITEM * (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const BatchTile batch = {rays, sorted, tile_at(item, row, in_bands)};
    prefetch_rays(&batch, item, end);
    int16 answered[PACKETS_OF_ITEM];
    count_together(GEOMETRY_AT(&geometry), &batch, counts, most, (1u << full_squares(end - item)) - 1u, answered);
    for (uint k = 0; k < PACKETS_OF_ITEM; k++) {
        for (ulong single = lanes_left(end - item, k, answered); single != 0ul; single = other_lanes8(single)) {
            const uint index = ray_in_square(&batch, square_in_tile(&batch.tile, k), first_lane16(single));
            Ray ray = batch_ray(rays, index, geometry.scale);
            counts[index] = count_of_ray(GEOMETRY_AT(&geometry), &ray, most);
        }
    }
}
