// What rounding leaves out of a difference, and of the point that a ray leaves a triangle from. For the three axes of
// one point (lanes/three.cl), or one axis of the points of sixteen rays.

// What a - b leaves out beside its rounding: the difference is exactly (a - b) + difference_low(a, b).
// Knuth, "The Art of Computer Programming", volume 2, section 4.2.2, theorem B.
REAL LANES(difference_low)(REAL a, REAL b) {
    const REAL difference = a - b;
    const REAL b_part = a - difference;
    return (a - (difference + b_part)) + (b_part - b);
}

// a + b as their rounded sum, which a becomes, and its rounding error, which b becomes (Knuth's TwoSum).
void LANES(two_sum)(REAL* a, REAL* b) {
    const REAL sum = *a + *b;
    const REAL part = sum - *a;
    *b = (*a - (sum - part)) + (*b - part);
    *a = sum;
}

// The product of v and s as a rounded product and its rounding error.
void LANES(two_product)(REAL v, FACTOR s, REAL* high, REAL* low) {
    *high = v * s;
    *low = fma(v, (REAL)(s), -*high);
}

// The point base + weight1 (other1 - base) + weight2 (other2 - base), rounded to *high, and the rest, rounded to *low.
// What makes traversals sound is that *low is off by at most 2 EPSILON of itself, however small it is: a plane of the
// structure lies on the same side of what they see as of the exact point. Three passes of error-free sums see to that
// (Ogita, Rump and Oishi, "Accurate Sum and Dot Product", SIAM J. Sci. Comput. 26(6), 2005): what is left out is below
// 2^-66 of the vertices, where it is not zero.
void LANES(point_of_triangle)(REAL base, REAL other1, REAL other2, FACTOR weight1, FACTOR weight2, REAL* high,
                              REAL* low) {
    REAL terms[POINT_TERMS];
    LANES(two_product)(other1, weight1, &terms[7], &terms[3]);
    LANES(two_product)(base, -weight1, &terms[6], &terms[2]);
    LANES(two_product)(other2, weight2, &terms[5], &terms[1]);
    LANES(two_product)(base, -weight2, &terms[4], &terms[0]);
    terms[8] = base;
#pragma unroll
    for (uint pass = 0; pass < POINT_PASSES; pass++)
#pragma unroll
        for (uint i = 1; i < POINT_TERMS; i++) LANES(two_sum)(&terms[i], &terms[i - 1]);
    REAL rest = terms[0];
#pragma unroll
    for (uint i = 1; i < POINT_TERMS - 1; i++) rest += terms[i];
    *high = terms[POINT_TERMS - 1];
    *low = rest;
    LANES(two_sum)(high, low);
}
