// Vectors of three axes, one in each lane: dot3() and cross3() of math.cl in the same order, so with the same bits.

typedef struct {
    REAL x, y, z;
} LANES(Vector);

REAL LANES(dot_product)(LANES(Vector) a, LANES(Vector) b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }

LANES(Vector) LANES(cross_product)(LANES(Vector) a, LANES(Vector) b) {
    const LANES(Vector) product = {LANES(difference_of_products)(a.y, b.z, a.z, b.y),
                                   LANES(difference_of_products)(a.z, b.x, a.x, b.z),
                                   LANES(difference_of_products)(a.x, b.y, a.y, b.x)};
    return product;
}

LANES(Vector) LANES(minus)(LANES(Vector) a, LANES(Vector) b) {
    const LANES(Vector) difference = {a.x - b.x, a.y - b.y, a.z - b.z};
    return difference;
}

#ifdef ONE_LANE
Vector vector_of(float3 v) {
    const Vector vector = {v.x, v.y, v.z};
    return vector;
}
#endif
