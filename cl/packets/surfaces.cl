// What the rays of a packet have hit, to the bit as SURFACE_HIT, surface_point() and triangle_normal() tell it of one
// ray. Those are chains of operations that wait for each other: of one ray after the other they take longer than its
// traversal.

#ifndef COUNT_HITS
typedef struct {
    float16 weight0, u, v;
    float16 weights[3];                    // start_weights()
    float16 position[3], position_low[3];  // start_on_triangle()
    float16 outward[3];                    // triangle_normal()
    float16 largest_coordinate;
} PacketSurfaces;

void cross16(const float16* a, const float16* b, float16* product) {
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        const uint j = (i + 1u) % 3u, k = (i + 2u) % 3u;
        product[i] = difference_of_products16(a[j], b[k], a[k], b[j]);
    }
}

// Of numbers.
float16 largest_of_three(const float16* v) { return larger16(fabs(v[0]), larger16(fabs(v[1]), fabs(v[2]))); }

// scale_to_unit() of lengths that it does not have to lift: the factor; and whether it is one.
float16 unit_scale(const float16* v, int16* is_scale) {
    const float16 size = largest_of_three(v);
    *is_scale = size >= SMALLEST_SCALED && size <= LARGEST_SCALED;
    return as_float16((254u - (as_uint16(size) >> 23)) << 23);
}

// normalize3(), and where it is that. 1 / |v| is the product of *scale and *inverse.
int16 normalize16(float16* v, float16* scale, float16* inverse) {
    int16 is_unit;
    *scale = unit_scale(v, &is_unit);
#pragma unroll
    for (uint i = 0; i < 3u; i++) v[i] *= *scale;
    *inverse = 1.0f / sqrt(fma(v[0], v[0], fma(v[1], v[1], v[2] * v[2])));
#pragma unroll
    for (uint i = 0; i < 3u; i++) v[i] *= *inverse;
    return is_unit;
}

// triangle_normal(), and where it is that.
int16 triangle_normals(const float16* p0, const float16* p1, const float16* p2, float16* normal) {
    float16 edge1[3], edge2[3], low1[3], low2[3], low_part1[3], low_part2[3], scale, inverse;
    int16 is_scale1, is_scale2;
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        edge1[i] = p1[i] - p0[i];
        edge2[i] = p2[i] - p0[i];
        low1[i] = difference_low16(p1[i], p0[i]);
        low2[i] = difference_low16(p2[i], p0[i]);
    }
    const float16 scale1 = unit_scale(edge1, &is_scale1), scale2 = unit_scale(edge2, &is_scale2);
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        edge1[i] *= scale1;
        low1[i] *= scale1;
        edge2[i] *= scale2;
        low2[i] *= scale2;
    }
    cross16(edge1, edge2, normal);
    cross16(edge1, low2, low_part1);
    cross16(low1, edge2, low_part2);
#pragma unroll
    for (uint i = 0; i < 3u; i++) normal[i] += low_part1[i] + low_part2[i];
    return is_scale1 && is_scale2 && normalize16(normal, &scale, &inverse);
}

// Tells weights and points of the lanes of `hits`. Returns those of which it is sure. *corners: nine coordinates.
ulong points_of_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const PacketAnswer* answer, ulong hits,
                       float16* corners, PacketSurfaces* s) {
    const uint* primitive = answer->primitive;
#pragma unroll
    for (uint i = 0; i < 9u; i++) corners[i] = (float16)(0.0f);
    for (ulong rest = hits; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        set_three_of_lane(corners, lane, LOAD_SURFACE_VERTEX(geometry, primitive[lane], 0));
        set_three_of_lane(corners + 3, lane, LOAD_SURFACE_VERTEX(geometry, primitive[lane], 1));
        set_three_of_lane(corners + 6, lane, LOAD_SURFACE_VERTEX(geometry, primitive[lane], 2));
    }
    const int16 is_sure = weights_of_answer(answer, p, corners, &s->weight0, &s->u, &s->v);
    // start_weights() and point_of_weights()
    const float16 rest = (1.0f - s->u) - s->v;
    const int16 at0 = rest >= s->u && rest >= s->v, at1 = !at0 && s->u >= s->v;
    s->weights[0] = at0 ? (float16)(-1.0f) : s->weight0;
    s->weights[1] = at1 ? (float16)(-1.0f) : s->u;
    s->weights[2] = at0 || at1 ? s->v : (float16)(-1.0f);
    const float16 weight1 = at0 ? s->u : at1 ? s->v : s->weight0, weight2 = at0 ? s->v : at1 ? s->weight0 : s->u;
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        const float16 p0 = corners[i], p1 = corners[3u + i], p2 = corners[6u + i];
        point_of_triangle16(at0   ? p0
                            : at1 ? p1
                                  : p2,
                            at0   ? p1
                            : at1 ? p2
                                  : p0,
                            at0   ? p2
                            : at1 ? p0
                                  : p1,
                            weight1, weight2, &s->position[i], &s->position_low[i]);
    }
    return lanes_where16(is_sure) & hits;
}

// The same with all else.
ulong surfaces_of_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const PacketAnswer* answer, ulong hits,
                         PacketSurfaces* s) {
    float16 corners[9];
    const ulong sure = points_of_packet(GEOMETRY, p, answer, hits, corners, s);
    s->largest_coordinate =
        larger16(largest_of_three(corners), larger16(largest_of_three(corners + 3), largest_of_three(corners + 6)));
    const int16 has_normal = triangle_normals(corners, corners + 3, corners + 6, s->outward);
    return sure & lanes_where16(has_normal);
}

// Fewer hits are looked at one after the other. 1 and 6 are as fast.
#define FEWEST_SURFACES 3u

// Through a pointer, for Oclgrind 21.10: see load_point() in cl/kernels/wavefront.cl.
void point_of_lane(GEOMETRY_PARAMETERS, const PacketSurfaces* s, uint lane, uint primitive, SurfacePoint* point) {
    point->position = three_of_lane(s->position, lane);
    point->position_low = three_of_lane(s->position_low, lane);
    point->weights = three_of_lane(s->weights, lane);
    point->error =
        LEAVING_ERROR(LOAD_SURFACE_VERTEX(geometry, primitive, 0), LOAD_SURFACE_VERTEX(geometry, primitive, 1),
                      LOAD_SURFACE_VERTEX(geometry, primitive, 2));
    point->primitive = primitive;
}

SurfaceHit hit_of_lane(const PacketSurfaces* s, uint lane, uint primitive) {
    const SurfaceHit hit = {lane_of16(&s->weight0, lane), lane_of16(&s->u, lane), lane_of16(&s->v, lane), primitive};
    return hit;
}
#endif
