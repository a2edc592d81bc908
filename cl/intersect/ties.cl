// Ties that need no arithmetic of the ray: where two triangles are met at the same t whatever the ray is, the number
// decides. Without this the exact test (exact.cl) would settle each tie anew in its longest numbers, which made
// thousands of triangles in one place, or one upon the other in one plane, twenty times as slow as others.

bool is_corner_of(float3 p, float3 q0, float3 q1, float3 q2) { return all(p == q0) || all(p == q1) || all(p == q2); }

// Whether two triangles are the same set of points. Triangles that are traced have area, so no two corners of one are
// alike: it is enough that each corner of the one is a corner of the other. The exact answers do not depend on the
// order of corners, so a ray that hits the one hits the other, at the same t.
bool are_same_points(float3 p0, float3 p1, float3 p2, float3 q0, float3 q1, float3 q2) {
    return is_corner_of(p0, q0, q1, q2) && is_corner_of(p1, q0, q1, q2) && is_corner_of(p2, q0, q1, q2);
}

// Whether two triangles certainly lie in one plane, so that a ray that hits both hits them at the same t. With every
// coordinate a multiple of 2^low, the product of the normal and a difference is one of 2^(3 low): it is zero if it is
// surely smaller. Pairs of doubles tell that of coordinates that have up to 31 bits between the largest and the last
// one; of more, decide_closer and decide_by_integers do.
#ifdef EXTENDED_IS_DOUBLE
#define COMMON_PLANE_ERROR 0x1p-100 // as CLOSER_ERROR, of which the start's products are left out here
RARE bool are_in_one_plane(float3 p0, float3 p1, float3 p2, float3 q0, float3 q1, float3 q2) {
    const DoubleDouble3 edge1 = dd3_difference(p1, p0), edge2 = dd3_difference(p2, p0);
    const DoubleDouble3 normal = dd3_cross(&edge1, &edge2);
    const double x1 = fabs(edge1.x.x), y1 = fabs(edge1.y.x), z1 = fabs(edge1.z.x);
    const double x2 = fabs(edge2.x.x), y2 = fabs(edge2.y.x), z2 = fabs(edge2.z.x);
    const double size_x = y1 * z2 + z1 * y2, size_y = z1 * x2 + x1 * z2, size_z = x1 * y2 + y1 * x2;
    const float3 corners[6] = {p0, p1, p2, q0, q1, q2};
    int low = 1000, high = -1000;
#pragma unroll 1
    for (int i = 0; i < 6; i++) {
        widen_exponents3(corners[i], &low, &high);
    }
    const double least = ldexp(0.5, 3 * low);
#pragma unroll 1
    for (int i = 3; i < 6; i++) {
        const DoubleDouble3 from = dd3_difference(corners[i], p0);
        const DoubleDouble height = dd3_dot(&normal, &from);
        const double error =
            1.01 * COMMON_PLANE_ERROR * (size_x * fabs(from.x.x) + size_y * fabs(from.y.x) + size_z * fabs(from.z.x));
        if (!(fabs(height.x) + error < least)) return false;
    }
    return true;
}
#else
bool are_in_one_plane(float3 p0, float3 p1, float3 p2, float3 q0, float3 q1, float3 q2) { return false; }
#endif
