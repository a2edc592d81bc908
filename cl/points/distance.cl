// How far triangles are from a point: in each lane one triangle, abc, with the point as the origin.
//
// A distance is held between two bounds that hold however wrong the computed closest point is. `reach` is the length of
// the longest of a, b and c, e stands for EPSILON.
// * From above: the length of any point q = a + s (b - a) + t (c - a) of the triangle. Rounding moves q by at most
//   5 e reach. u and v of a face may add up to 1 + 7.1 e, which moves q out of the triangle by 14.2 e reach. The length
//   is off by 8.5 e reach, with a square root that is off by 3 units in the last place, and the sum by e. In all 28.7 e
//   reach.
// * From below: for any direction d the triangle lies beyond the plane at min(a.d, b.d, c.d) / |d|. A product is off by
//   4.1 e reach |d|, the length of d and the division by 12.5 e at most. In all 16.6 e reach, and e for the sum.
// DISTANCE_ERROR is 32 e. LEAST_DISTANCE_ERROR is for all that gets lost below 2^-126: products, and the lowest bits of
// coordinates on their way to tracing space.
//
// Ericson, "Real-Time Collision Detection", 2005, section 5.1.5 (the closest point of a triangle).

// The closest point of a triangle so far, from the query's point as the origin.
typedef struct {
    LANES(Vector) to;
    REAL square;         // of its distance
    LANES(Vector) along; // the edge that it is inside of, the face's normal, or 0
    MASK is_inside;      // whether it is inside of the face
} LANES(Nearest);

// a * s + b
LANES(Vector) LANES(along_vector)(LANES(Vector) a, REAL s, LANES(Vector) b) {
    const LANES(Vector) sum = {fma(a.x, s, b.x), fma(a.y, s, b.y), fma(a.z, s, b.z)};
    return sum;
}

// One or the other in each lane.
LANES(Vector) LANES(either_vector)(MASK is_first, LANES(Vector) a, LANES(Vector) b) {
    const LANES(Vector) chosen = {is_first ? a.x : b.x, is_first ? a.y : b.y, is_first ? a.z : b.z};
    return chosen;
}

// Takes the closest point of the edge from `from` on where it is nearer.
INLINE void LANES(take_edge)(LANES(Vector) from, LANES(Vector) edge, LANES(Nearest)* nearest) {
    // Any s will do for an edge without length.
    const REAL along = -LANES(dot_product)(from, edge) / LANES(dot_product)(edge, edge);
    const REAL s = LANES(smaller)(LANES(larger)(along, (REAL)(0.0f)), (REAL)(1.0f));
    const LANES(Vector) to = LANES(along_vector)(edge, s, from);
    const LANES(Vector) nowhere = {(REAL)(0.0f), (REAL)(0.0f), (REAL)(0.0f)};
    const REAL square = LANES(dot_product)(to, to);
    const MASK is_nearer = square < nearest->square, is_within = s > 0.0f && s < 1.0f;
    nearest->to = LANES(either_vector)(is_nearer, to, nearest->to);
    nearest->square = is_nearer ? square : nearest->square;
    nearest->along =
        LANES(either_vector)(is_nearer, LANES(either_vector)(is_within, edge, nowhere), nearest->along);
}

// A point of the triangle that is about the closest one.
INLINE void LANES(nearest_of_triangle)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) c, LANES(Nearest)* nearest) {
    const LANES(Vector) edge1 = LANES(minus)(b, a), edge2 = LANES(minus)(c, a);
    nearest->to = a;
    nearest->square = LANES(dot_product)(a, a);
    nearest->along.x = nearest->along.y = nearest->along.z = (REAL)(0.0f);
    LANES(take_edge)(a, edge1, nearest);
    LANES(take_edge)(a, edge2, nearest);
    LANES(take_edge)(b, LANES(minus)(c, b), nearest);

    const LANES(Vector) normal = LANES(cross_product)(edge1, edge2);
    const REAL weight0 = LANES(dot_product)(normal, LANES(cross_product)(b, c));
    const REAL weight1 = LANES(dot_product)(normal, LANES(cross_product)(c, a));
    const REAL weight2 = LANES(dot_product)(normal, LANES(cross_product)(a, b));
    const REAL sum = (weight0 + weight1) + weight2;
    const LANES(Vector) on_edge = LANES(along_vector)(edge1, weight1 / sum, a);
    const LANES(Vector) to = LANES(along_vector)(edge2, weight2 / sum, on_edge);
    const REAL square = LANES(dot_product)(to, to);
    nearest->is_inside =
        weight0 >= 0.0f && weight1 >= 0.0f && weight2 >= 0.0f && sum > 0.0f && square <= nearest->square;
    nearest->to = LANES(either_vector)(nearest->is_inside, to, nearest->to);
    nearest->square = nearest->is_inside ? square : nearest->square;
    nearest->along = LANES(either_vector)(nearest->is_inside, normal, nearest->along);
}

// What bounds of the triangle's distance are off by.
REAL LANES(distance_error)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) c) {
    const REAL of_b_or_c = LANES(larger)(LANES(dot_product)(b, b), LANES(dot_product)(c, c));
    const REAL reach = sqrt(LANES(larger)(LANES(dot_product)(a, a), of_b_or_c));
    return fma((REAL)(DISTANCE_ERROR), reach, (REAL)(LEAST_DISTANCE_ERROR));
}

// A bound from above of the distance.
REAL LANES(farthest_distance)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) c) {
    LANES(Nearest) nearest;
    LANES(nearest_of_triangle)(a, b, c, &nearest);
    return sqrt(nearest.square) + LANES(distance_error)(a, b, c);
}

// Whether a bound from below of the distance is no more than that one. Of a point inside of a face or an edge the
// direction to it is mostly rounding where it is near: the face's normal is taken in its place, and what of the
// direction is along the edge is taken out. True where little is known.
MASK LANES(may_be_within)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) c, REAL distance) {
    LANES(Nearest) nearest;
    LANES(nearest_of_triangle)(a, b, c, &nearest);
    const REAL along = LANES(dot_product)(nearest.to, nearest.along);
    const REAL square = LANES(dot_product)(nearest.along, nearest.along);
    const REAL part = nearest.is_inside ? (REAL)(0.0f) : square > 0.0f ? along / square : (REAL)(0.0f);
    const LANES(Vector) beside = LANES(along_vector)(nearest.along, -part, nearest.to);
    const REAL side = along < 0.0f ? (REAL)(-1.0f) : (REAL)(1.0f);
    const LANES(Vector) upwards = {nearest.along.x * side, nearest.along.y * side, nearest.along.z * side};
    const LANES(Vector) given = LANES(either_vector)(nearest.is_inside, upwards, beside);
    const REAL magnitude = LANES(larger)(fabs(given.x), LANES(larger)(fabs(given.y), fabs(given.z)));
    const REAL scale = 1.0f / magnitude; // so that no square overflows, or underflows
    const LANES(Vector) direction = {given.x * scale, given.y * scale, given.z * scale};
    const REAL least = LANES(smaller)(
        LANES(dot_product)(a, direction),
        LANES(smaller)(LANES(dot_product)(b, direction), LANES(dot_product)(c, direction)));
    const REAL length = sqrt(LANES(dot_product)(direction, direction));
    const REAL bound = least / length - LANES(distance_error)(a, b, c);
    const MASK is_known = magnitude > SMALLEST_SCALED && magnitude < LARGEST_SCALED;
    return !(is_known && bound > distance);
}

// Boxes are farther than `distance` where the square of theirs is larger than this. That square may be too large by
// 5.1 EPSILON of itself.
float limit_of(float distance) { return distance * distance * BOX_LIMIT_UP; }
