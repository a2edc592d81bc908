// Packets of the rays of a batch (cl/traverse/batch.cl).

// Where the rays of a work-item are: those of the tile's squares, or those that `sorted` names from there on.
typedef struct {
    __global const TraceRay* rays;
    __global const uint* sorted;
    RayTile tile;
} BatchTile;

// The ray of a lane of a square.
uint ray_in_square(const BatchTile* batch, uint square, uint lane) {
    const uint place = place_in_square(&batch->tile, square, lane);
    return batch->sorted != NULL ? batch->sorted[place] : place;
}

// Asks for the rays of the next work-item, where they are sorted: they lie anywhere. From number `item` on there are
// this one's.
void prefetch_rays(const BatchTile* batch, uint item, uint end) {
    if (batch->sorted == NULL) return;
    for (uint i = item + 16u * PACKETS_OF_ITEM; i < min(item + 32u * PACKETS_OF_ITEM, end); i++)
        PREFETCH(batch->rays + batch->sorted[i]);
}

// How many squares of a work-item with `count` rays are full: those are packets.
uint full_squares(uint count) { return min(count / 16u, PACKETS_OF_ITEM); }

// The rays of square k that packets have not answered: of one that is not full all that there are.
ulong lanes_left(uint count, uint k, const int16* answered) {
    if (k < full_squares(count)) return ALL_LANES16 & ~lanes_where16(answered[k]);
    return lanes_where16(NUMBERS16 < (int)count - 16 * (int)k);
}

// The numbers of the sixteen rays of a square, one component after the other: origin, t_min, direction, t_max.
void load_components(const BatchTile* batch, uint square, float16* c) {
    float16 v[8], w[8];
    // From two rays a vector to one component a vector: the even lanes of pairs of vectors and the odd ones, three
    // times.
    if (batch->sorted != NULL) {
        __global const uint* ray = batch->sorted + square;
#pragma unroll
        for (uint i = 0; i < 8u; i++)
            v[i] = (float16)(vload8(0, (__global const float*)(batch->rays + ray[2u * i])),
                             vload8(0, (__global const float*)(batch->rays + ray[2u * i + 1u])));
    } else {
        __global const TraceRay* rays = batch->rays + square;
#pragma unroll
        for (uint i = 0; i < 8u; i++)
            v[i] = vload16(i % 2u, (__global const float*)(rays + i / 2u * batch->tile.stride));
    }
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

// A square of rays of a batch, as far as TRAVERSE_PACKETS wants it. Returns the lanes that have a ray: not those of
// extreme numbers, or that are not sound, which batch_ray() takes care of. *t_factor: by which t is multiplied for the
// caller's units.
int16 load_packet(const BatchTile* batch, uint square, float scale, RayPacket* p, float16* t_factor) {
    if (!(scale >= 1.0f / MODERATE && scale <= MODERATE)) return (int16)(0);
    float16 c[8], unit;
    load_components(batch, square, c);
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        p->origin[i] = c[i];
        p->origin_low[i] = (float16)(0.0f);
        p->direction[i] = c[4u + i];
    }
    p->has_low = false;
    p->t_near = c[3];
    p->t_far = c[7];
    p->skip = (uint16)(NO_PRIMITIVE);
    const int16 used = make_packet(p, scale, &unit);
    *t_factor = unit * (1.0f / scale);
    return used;
}

// Hits of sixteen lanes as arrays of Hit have them, four in each vector.
void hits_of_lanes(float16 t, float16 u, float16 v, uint16 primitive, float16* fours) {
    const float16 p = as_float16(primitive);
#define FOUR(a, b, c, d) \
    (float16)(t.a, u.a, v.a, p.a, t.b, u.b, v.b, p.b, t.c, u.c, v.c, p.c, t.d, u.d, v.d, p.d)
    fours[0] = FOUR(s0, s1, s2, s3);
    fours[1] = FOUR(s4, s5, s6, s7);
    fours[2] = FOUR(s8, s9, sa, sb);
    fours[3] = FOUR(sc, sd, se, sf);
#undef FOUR
}
