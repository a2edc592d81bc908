// How many hits rays have, counted in packets: one work-item counts those of PACKETS_OF_ITEM times sixteen rays of the
// caller's. The answers are those of count_hits.cl, which counts what packets do not answer.

// Counts the hits of a lane's triangles that are put aside, by its ray, behind those that it has counted.
RARE void count_postponed(GEOMETRY_PARAMETERS, Ray* ray, uint lane, PacketHits* hits) {
    uint* count = &((uint*)&hits->count)[lane];
    ray->most = 0u;
    for (uint i = 0; i < ((const uint*)&hits->postponed)[lane]; i++) {
        const uint reference = hits->postponed_references[lane][i];
        Hit counted = no_hit();
        test_triangle(GEOMETRY, ray, reference, &counted);
        if (counted_hits(&counted) == 0u) continue;
        list_counted(hits->listed, lane, *count, reference);
        (*count)++;
    }
}

// What is traced of the rays of a work-item.
typedef struct {
    RayPacket packets[PACKETS_OF_ITEM];
    PacketHits found[PACKETS_OF_ITEM];
    float16 t_factor[PACKETS_OF_ITEM]; // see load_packet()
    int16 answered[PACKETS_OF_ITEM];   // the lanes that have their counts
} CountedTile;

// Counts the hits of packets of sixteen rays each together, those of `full` (bits). Returns the packets that were
// traced.
uint count_together(GEOMETRY_PARAMETERS, const BatchTile* batch, const uint most, const uint full, CountedTile* tile) {
    uint traced = 0u;
    for (uint rest = full; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        tile->answered[k] = load_packet(batch, square_in_tile(&batch->tile, k), geometry->scale, &tile->packets[k],
                                        &tile->t_factor[k]);
        tile->found[k].most = most;
        if (is_any16(tile->answered[k])) traced |= 1u << k;
    }
    if (traced == 0u) return 0u;
    TRAVERSE_PACKETS(GEOMETRY, tile->packets, traced, false, tile->found);
    for (uint rest = traced; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest), square = square_in_tile(&batch->tile, k);
        PacketHits* found = &tile->found[k];
        tile->answered[k] = tile->answered[k] && !found->undecided_lanes;
        for (ulong open = lanes_where16(tile->answered[k] && found->postponed != 0u); open != 0ul;
             open = other_lanes8(open)) {
            const uint lane = first_lane16(open);
            Ray ray = batch_ray(batch->rays, ray_in_square(batch, square, lane), geometry->scale);
            count_postponed(GEOMETRY, &ray, lane, found);
        }
    }
    return traced;
}

// Writes how many hits the rays of a work-item have, up to `most`: of `count` rays, or of a whole tile if it has fewer.
// What packets do not answer is counted one ray after the other. Returns the packets that were traced.
uint count_tile(GEOMETRY_PARAMETERS, const BatchTile* batch, __global uint* counts, const uint most, const uint count,
                CountedTile* tile) {
    const uint traced = count_together(GEOMETRY, batch, most, (1u << full_squares(count)) - 1u, tile);
    for (uint rest = traced; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest), square = square_in_tile(&batch->tile, k);
        const uint16 of_lanes = min(tile->found[k].count, most);
        for (uint lane = 0; lane < 16u; lane++)
            counts[ray_in_square(batch, square, lane)] = ((const uint*)&of_lanes)[lane];
    }
    for (uint k = 0; k < PACKETS_OF_ITEM; k++) {
        for (ulong single = lanes_left(count, k, tile->answered); single != 0ul; single = other_lanes8(single)) {
            const uint index = ray_in_square(batch, square_in_tile(&batch->tile, k), first_lane16(single));
            Ray ray = batch_ray(batch->rays, index, geometry->scale);
            counts[index] = count_of_ray(GEOMETRY, &ray, most);
        }
    }
    return traced;
}

// How many hits each ray has, up to `most`.
#ifndef LIST_COUNTED
__kernel void count_hits_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                                 __global uint* restrict counts, ORDER_ARGUMENT const uint most, const uint first,
                                 const uint end) {
    const uint item = first + 16u * PACKETS_OF_ITEM * (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const BatchTile batch = {rays, sorted, tile_at(item, row, in_bands)};
    prefetch_rays(&batch, item, end);
    CountedTile tile;
    (void)count_tile(GEOMETRY_AT(&geometry), &batch, counts, most, end - item, &tile);
}
#endif
