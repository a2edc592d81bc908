// Which of the eight triangles of a wide leaf a ray may hit: the others are left out, and these take the triangle test
// one after the other. A filter must let pass whatever the test would find a hit.
//
// FILTER names it: `sheared` for tests that agree with the edge functions of edges.cl, `none` for all others.
//
// A packet of triangles is BVH8_PACKET_RECORDS records of `bounds`: for each vertex and axis the coordinates of the
// eight, two records.

// The constants of `sheared`, of a ray.
typedef struct {
    uint x, y, z; // records of the axes that become x, y and z, from those of a vertex on
    float origin_x, origin_y, origin_z, low_x, low_y, low_z;
    float shear_x, shear_y, error;
} Filter;

Filter make_filter(const Ray* ray) {
    const uint axis = ray->shear.axis;
    const float3 origin = swap_to_z(ray->origin, axis), low = swap_to_z(ray->origin_low, axis);
    const Filter filter = {axis == 0u ? 4u : 0u, axis == 1u ? 4u : 2u, 2u * axis, origin.x, origin.y, origin.z,
                           low.x, low.y, low.z, ray->shear.x, ray->shear.y, edge_error(low)};
    return filter;
}

// The lanes of packet number `packet` that the ray may hit. Sheared as in shear_triangle(), so that the edge functions
// have its bits.
ulong filter_sheared(GEOMETRY_PARAMETERS, const Filter* f, uint packet) {
    float8 x[3], y[3], z[3];
    for (uint corner = 0; corner < 3u; corner++) {
        const uint record = BVH8_PACKET_RECORDS * packet + 6u * corner;
        z[corner] = (LOAD_PACKET(geometry, record + f->z) - f->origin_z) - f->low_z;
        x[corner] =
            fma((float8)(-f->shear_x), z[corner], (LOAD_PACKET(geometry, record + f->x) - f->origin_x) - f->low_x);
        y[corner] =
            fma((float8)(-f->shear_y), z[corner], (LOAD_PACKET(geometry, record + f->y) - f->origin_y) - f->low_y);
    }
    const Edges8 e = edges_of8(f->error, x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]);
    return lanes_where8(!surely_missed(e));
}

ulong filter_none(GEOMETRY_PARAMETERS, const Filter* f, uint packet) { return ALL_LANES8; }

#ifndef FILTER
#define FILTER none
#endif
