// Batch queries in packets: one work-item traces PACKETS_OF_ITEM times sixteen rays of the caller's, one behind the
// other in the batch.

// Writes the hits of a square's rays.
void store_hits(const BatchTile* batch, __global Hit* hits, uint square, float16 t, float16 u, float16 v,
                uint16 primitive) {
    float16 fours[4];
    hits_of_lanes(t, u, v, primitive, fours);
    if (batch->sorted != NULL) {
        for (uint lane = 0; lane < 16u; lane++)
            vstore4(vload4(lane, (const float*)fours), 0,
                    (__global float*)(hits + batch->sorted[square + lane]));
        return;
    }
#pragma unroll
    for (uint i = 0; i < 4u; i++)
        vstore16(fours[i], 0, (__global float*)(hits + square + i * batch->tile.stride));
}

// Traces packets of sixteen rays each together, those of `full` (bits). Writes to `answered` the lanes that have their
// hits.
void trace_together(GEOMETRY_PARAMETERS, const BatchTile* batch, __global Hit* hits, const uint full,
                    const bool any_hit, int16* answered) {
    RayPacket packets[PACKETS_OF_ITEM];
    PacketHits found[PACKETS_OF_ITEM];
    float16 t_factor[PACKETS_OF_ITEM];
    uint traced = 0u;
    for (uint rest = full; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        answered[k] =
            load_packet(batch, square_in_tile(&batch->tile, k), geometry->scale, &packets[k], &t_factor[k]);
        if (is_any16(answered[k])) traced |= 1u << k;
    }
    if (traced == 0u) return;
    TRAVERSE_PACKETS(GEOMETRY, packets, traced, any_hit, found);
    for (; traced != 0u; traced &= traced - 1u) {
        const uint k = first_member(traced), square = square_in_tile(&batch->tile, k);
        FinishedHits hit;
        for (ulong open = unsettled_lanes(&found[k], any_hit); open != 0ul; open = other_lanes8(open)) {
            const uint lane = first_lane16(open);
            const Ray ray = batch_ray(batch->rays, ray_in_square(batch, square, lane), geometry->scale);
            settle_lane(GEOMETRY, &ray, lane, any_hit, &found[k]);
        }
        const int16 unfinished = finish_packet(GEOMETRY, &packets[k], &found[k], any_hit, &hit);
        // A t that may have lost bits is left to single rays.
        const float16 t = hit.t * t_factor[k];
        const int16 is_miss = hit.primitive == NO_PRIMITIVE;
        const int16 is_exact =
            any_hit ? (int16)(-1) : is_miss || hit.t == 0.0f || (fabs(t) >= FLT_MIN && fabs(t) <= FLT_MAX);
        store_hits(batch, hits, square, any_hit && !is_miss ? (float16)(0.0f) : t, hit.u, hit.v, hit.primitive);
        const int16 is_settled = answered[k] && !found[k].undecided_lanes;
        answered[k] = is_settled && !unfinished && is_exact;
        for (ulong open = lanes_where16(is_settled && unfinished); open != 0ul; open = other_lanes8(open)) {
            const uint lane = first_lane16(open), index = ray_in_square(batch, square, lane);
            const Ray ray = batch_ray(batch->rays, index, geometry->scale);
            Hit closer;
            if (!finish_lane(GEOMETRY, &ray, lane, &found[k], &closer)) continue;
            hits[index] = batch_hit(closer);
            ((int*)&answered[k])[lane] = -1;
        }
    }
}

// The rays of one work-item: the first `count` of a tile, or all if it has fewer. What packets do not answer is traced
// one ray after the other.
void trace_tile(GEOMETRY_PARAMETERS, DEFERRED_ARGUMENT const BatchTile* batch, __global Hit* hits, uint count,
                const bool any_hit) {
    int16 answered[PACKETS_OF_ITEM];
    trace_together(GEOMETRY, batch, hits, (1u << full_squares(count)) - 1u, any_hit, answered);
    for (uint k = 0; k < PACKETS_OF_ITEM; k++) {
        for (ulong single = lanes_left(count, k, answered); single != 0ul; single = other_lanes8(single)) {
            const uint index = ray_in_square(batch, square_in_tile(&batch->tile, k), first_lane16(single));
            Hit hit;
            if (!trace_batch(GEOMETRY, batch->rays, hits, index, any_hit, &hit))
                settle_batch(GEOMETRY, batch->rays, hits, index, any_hit, hit);
            if (FORGET_DEFERRED(geometry)) ADD_DEFERRED(index);
        }
    }
}

// The closest hit of each ray, as trace_closest.
__kernel void trace_closest_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                                    __global Hit* restrict hits, DEFERRED_ARGUMENT ORDER_ARGUMENT const uint first,
                                    const uint end) {
    const uint item = first + 16u * PACKETS_OF_ITEM * (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const BatchTile batch = {rays, sorted, tile_at(item, row, in_bands)};
    prefetch_rays(&batch, item, end);
    trace_tile(GEOMETRY_AT(&geometry), deferred, &batch, hits, end - item, false);
}

// Some hit of each ray, as trace_any.
__kernel void trace_any_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                                DEFERRED_ARGUMENT ORDER_ARGUMENT const uint first, const uint end) {
    const uint item = first + 16u * PACKETS_OF_ITEM * (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const BatchTile batch = {rays, sorted, tile_at(item, row, in_bands)};
    prefetch_rays(&batch, item, end);
    trace_tile(GEOMETRY_AT(&geometry), deferred, &batch, hits, end - item, true);
}
