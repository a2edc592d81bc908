// Batch queries in packets: one work-item traces sixteen rays of the caller's, one behind the other in the batch.

// The numbers of sixteen rays, one component after the other: origin, t_min, direction, t_max.
void load_components(__global const TraceRay* rays, float16* c) {
    __global const float* words = (__global const float*)rays;
    float16 v[8], w[8];
    // From two rays a vector to one component a vector: the even lanes of pairs of vectors and the odd ones, three times.
#pragma unroll
    for (uint i = 0; i < 8u; i++) v[i] = vload16(i, words);
#pragma unroll
    for (uint i = 0; i < 4u; i++) {
        w[i] = (float16)(v[2u * i].even, v[2u * i + 1u].even);
        w[4u + i] = (float16)(v[2u * i].odd, v[2u * i + 1u].odd);
    }
#pragma unroll
    for (uint i = 0; i < 2u; i++) {
#pragma unroll
        for (uint j = 0; j < 2u; j++) {
            const uint pair = 4u * i + 2u * j;
            v[4u * i + j] = (float16)(w[pair].even, w[pair + 1u].even);
            v[4u * i + 2u + j] = (float16)(w[pair].odd, w[pair + 1u].odd);
        }
    }
#pragma unroll
    for (uint i = 0; i < 4u; i++) {
        const uint component = 2u * (i % 2u) + i / 2u;
        c[component] = (float16)(v[2u * i].even, v[2u * i + 1u].even);
        c[4u + component] = (float16)(v[2u * i].odd, v[2u * i + 1u].odd);
    }
}

// A packet of rays of a batch, as far as complete_packet() wants it. Returns the lanes that have a ray: not those of extreme numbers,
// or that are not sound, which batch_ray() takes care of. *t_factor: by which t is multiplied for the caller's units.
int16 load_packet(__global const TraceRay* rays, float scale, RayPacket* p, float16* t_factor) {
    float16 c[8];
    load_components(rays, c);
    const float16 t_min = c[3], t_max = c[7];
    const float16 size = larger16(fabs(c[4]), larger16(fabs(c[5]), fabs(c[6])));
    const int16 used = is_moderate(c[0]) && is_moderate(c[1]) && is_moderate(c[2]) && is_moderate(c[4]) && is_moderate(c[5]) &&
                       is_moderate(c[6]) && size > 0.0f && is_moderate(t_min) && (is_moderate(t_max) || t_max == INFINITY) &&
                       t_min <= t_max && is_moderate((float16)(scale));
    if (!is_any16(used)) return used;
    // power_of_two_scale() of the largest component
    const float16 unit = used ? as_float16((254u - (as_uint16(size) >> 23)) << 23) : (float16)(1.0f);
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        p->origin[i] = c[i];
        p->origin_low[i] = (float16)(0.0f);
        p->direction[i] = c[4u + i] * unit;
    }
    p->has_low = false;
    *t_factor = unit / scale;
    const float16 to_own = scale / unit;
    p->t_near = t_min * to_own;
    p->t_far = smaller16(t_max * to_own, (float16)(FLT_MAX));
    p->skip = (uint16)(NO_PRIMITIVE);
    leave_out_others(p, used);
    return used;
}

// Writes sixteen hits, with components one after the other.
void store_hits(__global Hit* hits, float16 t, float16 u, float16 v, uint16 primitive) {
    __global float* words = (__global float*)hits;
    const float16 p = as_float16(primitive);
    vstore16((float16)(t.s0, u.s0, v.s0, p.s0, t.s1, u.s1, v.s1, p.s1, t.s2, u.s2, v.s2, p.s2, t.s3, u.s3, v.s3, p.s3), 0, words);
    vstore16((float16)(t.s4, u.s4, v.s4, p.s4, t.s5, u.s5, v.s5, p.s5, t.s6, u.s6, v.s6, p.s6, t.s7, u.s7, v.s7, p.s7), 1, words);
    vstore16((float16)(t.s8, u.s8, v.s8, p.s8, t.s9, u.s9, v.s9, p.s9, t.sa, u.sa, v.sa, p.sa, t.sb, u.sb, v.sb, p.sb), 2, words);
    vstore16((float16)(t.sc, u.sc, v.sc, p.sc, t.sd, u.sd, v.sd, p.sd, t.se, u.se, v.se, p.se, t.sf, u.sf, v.sf, p.sf), 3, words);
}

// Traces sixteen rays together. Returns the lanes that have their hits.
int16 trace_together(GEOMETRY_PARAMETERS, __global const TraceRay* rays, __global Hit* hits, const bool any_hit) {
    RayPacket packet;
    float16 t_factor;
    const int16 used = load_packet(rays, geometry->scale, &packet, &t_factor);
    if (!is_any16(used)) return used;
    complete_packet(&packet, geometry->low, geometry->high);
    PacketHits found;
    int16 doubtful;
    Frustum frustum;
    const bool has_frustum = make_frustum(&packet, geometry->low, geometry->high, &frustum);
    traverse_bvh8_packet(GEOMETRY, &packet, has_frustum ? &frustum : 0, any_hit, &found, &doubtful);
    FinishedHits hit;
    finish_packet(GEOMETRY, &packet, &found, any_hit, &hit, &doubtful);
    // batch_hit() takes care of a t that may have lost bits.
    const float16 t = hit.t * t_factor;
    const int16 is_miss = hit.primitive == NO_PRIMITIVE;
    const int16 is_exact = is_miss || (fabs(t) >= FLT_MIN && fabs(t) <= FLT_MAX);
    store_hits(hits, any_hit && !is_miss ? (float16)(0.0f) : t, hit.u, hit.v, hit.primitive);
    return used && !doubtful && is_exact;
}

// Rays first..first + 15 of those before `end`. What a packet does not answer is traced one ray after the other.
void trace_sixteen(GEOMETRY_PARAMETERS, __global const TraceRay* rays, __global Hit* hits, volatile __global uint* doubts, uint first,
                   uint end, const bool any_hit) {
    const bool is_full = end - first >= 16u;
    const int16 answered = is_full ? trace_together(GEOMETRY, rays + first, hits + first, any_hit) : (int16)(0);
    for (ulong alone = ALL_LANES16 & ~lanes_where16(answered); alone != 0ul; alone = other_lanes8(alone)) {
        const uint index = first + first_lane16(alone);
        if (index >= end) continue;
        trace_batch(GEOMETRY, rays, hits, index, any_hit);
        if (TAKE_IN_DOUBT(geometry)) ADD_DOUBT(index);
    }
}

// The closest hit of each ray, as trace_closest.
__kernel void trace_closest_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                                    DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint packet = first + 16u * (uint)get_global_id(0);
    if (packet >= end) return;
    UNDECIDED
    const Geometry geometry = MAKE_GEOMETRY;
    trace_sixteen(GEOMETRY_AT(&geometry), rays, hits, doubts, packet, end, false);
}

// Some hit of each ray, as trace_any.
__kernel void trace_any_packets(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                                DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint packet = first + 16u * (uint)get_global_id(0);
    if (packet >= end) return;
    UNDECIDED
    const Geometry geometry = MAKE_GEOMETRY;
    trace_sixteen(GEOMETRY_AT(&geometry), rays, hits, doubts, packet, end, true);
}
