// Pairs of doubles: about 104 bits, for what double leaves open, where the device has double.
// Joldes, Muller and Popescu, "Tight and Rigorous Error Bounds for Basic Building Blocks of Double-Word Arithmetic",
// ACM TOMS 44(2), 2017: with u = 2^-53, a sum is off by 3 u^2 of its operands' magnitudes, a product by 5 u^2, a
// quotient by 10 u^2 of itself.

#ifdef EXTENDED_IS_DOUBLE
typedef double2 DoubleDouble; // the value is x + y, and x is that rounded

DoubleDouble dd_normal(double high, double low) {
    const double sum = high + low;
    return (DoubleDouble)(sum, low - (sum - high));
}
DoubleDouble dd_sum(double a, double b) {
    const double sum = a + b;
    const double b_part = sum - a;
    return (DoubleDouble)(sum, (a - (sum - b_part)) + (b - b_part));
}
DoubleDouble dd_difference(float a, float b) { return dd_sum((double)a, -(double)b); }
DoubleDouble dd_add(DoubleDouble a, DoubleDouble b) {
    const DoubleDouble high = dd_sum(a.x, b.x);
    const DoubleDouble low = dd_sum(a.y, b.y);
    const DoubleDouble sum = dd_normal(high.x, high.y + low.x);
    return dd_normal(sum.x, low.y + sum.y);
}
DoubleDouble dd_subtract(DoubleDouble a, DoubleDouble b) { return dd_add(a, -b); }
DoubleDouble dd_multiply(DoubleDouble a, DoubleDouble b) {
    const double high = a.x * b.x;
    const double low = fma(a.x, b.x, -high);
    return dd_normal(high, low + fma(a.x, b.y, a.y * b.x));
}
DoubleDouble dd_divide(DoubleDouble a, DoubleDouble b) {
    const double high = a.x / b.x;
    const DoubleDouble rest = dd_subtract(a, dd_multiply(b, (DoubleDouble)(high, 0.0)));
    return dd_normal(high, rest.x / b.x);
}

// The float nearest to a: rounded to odd first, which keeps what lies behind the last bit of a double from getting lost
// (Boldo and Melquiond, "Emulation of FMA and Correctly Rounded Sums: Proved Algorithms Using Rounding to Odd", IEEE
// Trans. Computers 57(4), 2008).
float dd_to_float(DoubleDouble a) {
    ulong bits = as_ulong(a.x);
    if (a.y != 0.0 && (bits & 1ul) == 0ul) bits = (a.y > 0.0) == (a.x > 0.0) ? bits + 1ul : bits - 1ul;
    return (float)as_double(bits);
}

typedef struct {
    DoubleDouble x, y, z;
} DoubleDouble3;

DoubleDouble3 dd3_difference(float3 a, float3 b) {
    const DoubleDouble3 r = {dd_difference(a.x, b.x), dd_difference(a.y, b.y), dd_difference(a.z, b.z)};
    return r;
}
DoubleDouble3 dd3_from(float3 a) {
    const DoubleDouble3 r = {(DoubleDouble)((double)a.x, 0.0), (DoubleDouble)((double)a.y, 0.0),
                             (DoubleDouble)((double)a.z, 0.0)};
    return r;
}
DoubleDouble3 dd3_subtract(const DoubleDouble3* a, const DoubleDouble3* b) {
    const DoubleDouble3 r = {dd_subtract(a->x, b->x), dd_subtract(a->y, b->y), dd_subtract(a->z, b->z)};
    return r;
}
// sum + a * s
DoubleDouble3 dd3_add_product(const DoubleDouble3* sum, const DoubleDouble3* a, float s) {
    const DoubleDouble factor = (DoubleDouble)((double)s, 0.0);
    const DoubleDouble3 r = {dd_add(sum->x, dd_multiply(a->x, factor)), dd_add(sum->y, dd_multiply(a->y, factor)),
                             dd_add(sum->z, dd_multiply(a->z, factor))};
    return r;
}
// a x b.
DoubleDouble3 dd3_cross(const DoubleDouble3* a, const DoubleDouble3* b) {
    const DoubleDouble3 r = {dd_subtract(dd_multiply(a->y, b->z), dd_multiply(a->z, b->y)),
                             dd_subtract(dd_multiply(a->z, b->x), dd_multiply(a->x, b->z)),
                             dd_subtract(dd_multiply(a->x, b->y), dd_multiply(a->y, b->x))};
    return r;
}
DoubleDouble dd3_dot(const DoubleDouble3* a, const DoubleDouble3* b) {
    return dd_add(dd_add(dd_multiply(a->x, b->x), dd_multiply(a->y, b->y)), dd_multiply(a->z, b->z));
}
#endif
