// Triangle tests of cl/intersect/ in packets: one triangle against sixteen rays, and one ray against eight triangles.
// The arithmetic is that of one lane, so a lane's t, u and v are those of its ray by itself, to the bit.
//
// Each test that PACKET_TEST may name has
//     rays_of_NAME       what it wants of a packet beside origins and directions
//     ray_of_NAME        the same of one ray of it
//     triangles_of_NAME  what it wants of eight triangles in place of their vertices
//     sixteen_NAME       which rays meet triangle i of these, and t, u and v
//     eight_NAME         which triangles the ray meets, and t, u and v
// A t that is no number is left to the caller's limits.

// The vertices of eight triangles, one after the other, x, y and z of each; or what triangles_of_NAME makes of them.
typedef struct {
    float8 corners[9];
} LeafTriangles_rounded;

// What watertight.cl wants of rays: Shear of ray.cl.
typedef struct {
    float16 x, y, z;
    int16 is_along_x, is_along_y; // the axis of the largest component
    uint axis;                    // where all have the same
    bool is_mixed;
} PacketShears;

// A ray of a packet that goes on by itself.
typedef struct {
    LaneRay line;
    Shear shear;
    uint skip;
    // Its hit so far. t_limit is t where there is one, and where the ray ends where there is none.
    float t_limit, u, v;
    uint primitive;
    bool is_found; // since it goes by itself
} SingleRay_rounded;

float16 number_of_triangle(const LeafTriangles_rounded* l, uint i, uint number) {
    return (float16)(lane_of8(&l->corners[number], i));
}
Vector16 vector_of_triangle(const LeafTriangles_rounded* l, uint i, uint first) {
    const Vector16 v = {number_of_triangle(l, i, first), number_of_triangle(l, i, first + 1u),
                        number_of_triangle(l, i, first + 2u)};
    return v;
}
// A vertex as seen from where the rays start.
Vector16 corner_from_origins(const RayPacket* p, const LeafTriangles_rounded* l, uint i, uint corner) {
    const Vector16 v = {from_origins(p, 0u, number_of_triangle(l, i, 3u * corner)),
                        from_origins(p, 1u, number_of_triangle(l, i, 3u * corner + 1u)),
                        from_origins(p, 2u, number_of_triangle(l, i, 3u * corner + 2u))};
    return v;
}
Vector16 directions_of(const RayPacket* p) {
    const Vector16 v = {p->direction[0], p->direction[1], p->direction[2]};
    return v;
}

Vector8 eight_vectors(const LeafTriangles_rounded* l, uint first) {
    const Vector8 v = {l->corners[first], l->corners[first + 1u], l->corners[first + 2u]};
    return v;
}
Vector8 same_eight(float3 v) {
    const Vector8 eight = {(float8)(v.x), (float8)(v.y), (float8)(v.z)};
    return eight;
}
// Vertices as seen from where the ray starts: from_origin() of ray.cl.
Vector8 eight_from_origin(const SingleRay_rounded* ray, const LeafTriangles_rounded* l, uint corner) {
    const Vector8 v = eight_vectors(l, 3u * corner);
    return minus8(minus8(v, same_eight(ray->line.origin)), same_eight(ray->line.origin_low));
}

void rays_of_moller_trumbore(const RayPacket* p, PacketShears* shears) {}
void ray_of_moller_trumbore(const PacketShears* shears, uint lane, Shear* shear) {}
// Edges in place of vertices 1 and 2.
void triangles_of_moller_trumbore(LeafTriangles_rounded* l) {
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        l->corners[3u + axis] -= l->corners[axis];
        l->corners[6u + axis] -= l->corners[axis];
    }
}
int16 sixteen_moller_trumbore(const RayPacket* p, const PacketShears* shears, const LeafTriangles_rounded* l, uint i,
                              float16* t, float16* u, float16* v) {
    const Vector16 p0 = corner_from_origins(p, l, i, 0u), from_p0 = {-p0.x, -p0.y, -p0.z};
    const Vector16 edge1 = vector_of_triangle(l, i, 3u), edge2 = vector_of_triangle(l, i, 6u);
    return moller_trumbore16(from_p0, directions_of(p), edge1, edge2, t, u, v);
}
int8 eight_moller_trumbore(const SingleRay_rounded* ray, const LeafTriangles_rounded* l, float8* t, float8* u,
                           float8* v) {
    const Vector8 p0 = eight_from_origin(ray, l, 0u), from_p0 = {-p0.x, -p0.y, -p0.z};
    const Vector8 direction = same_eight(ray->line.direction);
    return moller_trumbore8(from_p0, direction, eight_vectors(l, 3u), eight_vectors(l, 6u), t, u, v);
}

void rays_of_plucker(const RayPacket* p, PacketShears* shears) {}
void ray_of_plucker(const PacketShears* shears, uint lane, Shear* shear) {}
void triangles_of_plucker(LeafTriangles_rounded* l) {}
int16 sixteen_plucker(const RayPacket* p, const PacketShears* shears, const LeafTriangles_rounded* l, uint i,
                      float16* t, float16* u, float16* v) {
    return plucker16(corner_from_origins(p, l, i, 0u), corner_from_origins(p, l, i, 1u),
                     corner_from_origins(p, l, i, 2u), directions_of(p), t, u, v);
}
int8 eight_plucker(const SingleRay_rounded* ray, const LeafTriangles_rounded* l, float8* t, float8* u, float8* v) {
    return plucker8(eight_from_origin(ray, l, 0u), eight_from_origin(ray, l, 1u), eight_from_origin(ray, l, 2u),
                    same_eight(ray->line.direction), t, u, v);
}

// shear_towards() and shear_along() of ray.cl.
float16 shears_towards(float16 x, float16 z, float16 inv_z) {
    const float16 shear = x * inv_z;
    return fma(fma(-shear, z, x), inv_z, shear);
}
void rays_of_watertight(const RayPacket* p, PacketShears* shears) {
    const float16 size_x = fabs(p->direction[0]), size_y = fabs(p->direction[1]), size_z = fabs(p->direction[2]);
    const int16 is_x = size_x >= size_y && size_x >= size_z, is_y = !(size_x >= size_y) && size_y >= size_z;
    const float16 x = is_x ? p->direction[2] : p->direction[0], y = is_y ? p->direction[2] : p->direction[1];
    shears->z = is_x   ? p->direction[0]
                : is_y ? p->direction[1]
                       : p->direction[2];
    const float16 inv_z = 1.0f / shears->z;
    shears->x = shears_towards(x, shears->z, inv_z);
    shears->y = shears_towards(y, shears->z, inv_z);
    shears->is_along_x = is_x;
    shears->is_along_y = is_y;
    shears->axis = !is_any16(!is_x) ? 0u : !is_any16(!is_y) ? 1u : 2u;
    shears->is_mixed = shears->axis == 2u && is_any16(is_x || is_y);
}
void ray_of_watertight(const PacketShears* shears, uint lane, Shear* shear) {
    shear->axis =
        ((const int*)&shears->is_along_x)[lane] != 0 ? 0u : ((const int*)&shears->is_along_y)[lane] != 0 ? 1u : 2u;
    shear->x = lane_of16(&shears->x, lane);
    shear->y = lane_of16(&shears->y, lane);
    shear->z = lane_of16(&shears->z, lane);
}
void triangles_of_watertight(LeafTriangles_rounded* l) {}
// A vertex in the space where each ray is the z axis: shear_triangle() of watertight.cl.
Vector16 sheared_corner(const RayPacket* p, const PacketShears* shears, const LeafTriangles_rounded* l, uint i,
                        uint corner) {
    float16 x, y, z;
    if (!shears->is_mixed) {
        const uint axis = shears->axis, axis_x = axis == 0u ? 2u : 0u, axis_y = axis == 1u ? 2u : 1u;
        x = from_origins(p, axis_x, number_of_triangle(l, i, 3u * corner + axis_x));
        y = from_origins(p, axis_y, number_of_triangle(l, i, 3u * corner + axis_y));
        z = from_origins(p, axis, number_of_triangle(l, i, 3u * corner + axis));
    } else {
        const Vector16 from = corner_from_origins(p, l, i, corner);
        x = shears->is_along_x ? from.z : from.x;
        y = shears->is_along_y ? from.z : from.y;
        z = shears->is_along_x   ? from.x
            : shears->is_along_y ? from.y
                                 : from.z;
    }
    const Vector16 sheared = {fma(-shears->x, z, x), fma(-shears->y, z, y), z};
    return sheared;
}
int16 sixteen_watertight(const RayPacket* p, const PacketShears* shears, const LeafTriangles_rounded* l, uint i,
                         float16* t, float16* u, float16* v) {
    return watertight16(sheared_corner(p, shears, l, i, 0u), sheared_corner(p, shears, l, i, 1u),
                        sheared_corner(p, shears, l, i, 2u), shears->z, t, u, v);
}
Vector8 eight_sheared(const SingleRay_rounded* ray, const LeafTriangles_rounded* l, uint corner) {
    const Vector8 from = eight_from_origin(ray, l, corner);
    const uint axis = ray->shear.axis;
    const float8 x = axis == 0u ? from.z : from.x, y = axis == 1u ? from.z : from.y;
    const float8 z = axis == 0u ? from.x : axis == 1u ? from.y : from.z;
    const Vector8 sheared = {fma((float8)(-ray->shear.x), z, x), fma((float8)(-ray->shear.y), z, y), z};
    return sheared;
}
int8 eight_watertight(const SingleRay_rounded* ray, const LeafTriangles_rounded* l, float8* t, float8* u, float8* v) {
    return watertight8(eight_sheared(ray, l, 0u), eight_sheared(ray, l, 1u), eight_sheared(ray, l, 2u),
                       (float8)(ray->shear.z), t, u, v);
}
