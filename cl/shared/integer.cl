// Exact integers of any length that a ray-triangle test needs, for the rare decisions that no rounded arithmetic can
// make.
//
// Every float is an integer times a power of two. Multiplied by a common power of two, the coordinates of a ray and a
// triangle are integers, and so are all sums and products of them: their signs and quotients are exact. Two's
// complement, least significant limb first; every function takes the number n of limbs that the caller has found to
// suffice.

#define MAX_LIMBS 59 // see integer_units() in cl/intersect/exact_integers.cl

// A copy of a function at each of its many calls would take compilers longer than all tracing takes: 17 s on NVIDIA's.
// PoCL's is to make what is rare small as well, which is sooner done.
#define APART __attribute__((noinline))
#ifdef POCL_DEVICE_ADDRESS_BITS
#define RARE __attribute__((noinline, cold, minsize))
#else
#define RARE APART
#endif

typedef struct {
    uint limb[MAX_LIMBS];
} Integer;

bool integer_is_negative(const Integer* a, int n) { return (a->limb[n - 1] >> 31) != 0u; }

bool integer_is_zero(const Integer* a, int n) {
    uint any = 0;
#pragma unroll 1
    for (int i = 0; i < n; i++) any |= a->limb[i];
    return any == 0u;
}

// -1, 0 or 1.
int integer_sign(const Integer* a, int n) {
    return integer_is_negative(a, n) ? -1 : integer_is_zero(a, n) ? 0 : 1;
}

void integer_set_zero(Integer* a, int n) {
#pragma unroll 1
    for (int i = 0; i < n; i++) a->limb[i] = 0;
}

void integer_set_limb(Integer* a, uint limb, int n) {
    integer_set_zero(a, n);
    a->limb[0] = limb;
}

// *a = *a + sign * b for sign 1 or -1.
RARE void integer_add(Integer* a, const Integer* b, int sign, int n) {
    const uint flip = sign < 0 ? 0xffffffffu : 0u;
    ulong carry = flip & 1u;
#pragma unroll 1
    for (int i = 0; i < n; i++) {
        carry += (ulong)a->limb[i] + (b->limb[i] ^ flip);
        a->limb[i] = (uint)carry;
        carry >>= 32;
    }
}

// *a = |a|; returns the sign that a had.
int integer_take_sign(Integer* a, int n) {
    const int sign = integer_sign(a, n);
    if (sign < 0) {
        ulong carry = 1;
#pragma unroll 1
        for (int i = 0; i < n; i++) {
            carry += ~a->limb[i];
            a->limb[i] = (uint)carry;
            carry >>= 32;
        }
    }
    return sign;
}

// *magnitude = |a|; returns how many limbs of it matter, and changes *sign if a is negative.
int integer_magnitude(const Integer* a, Integer* magnitude, int* sign, int n) {
    const uint flip = integer_is_negative(a, n) ? 0xffffffffu : 0u;
    if (flip != 0u) *sign = -*sign;
    int length = 0;
    ulong carry = flip & 1u;
#pragma unroll 1
    for (int i = 0; i < n; i++) {
        carry += a->limb[i] ^ flip;
        magnitude->limb[i] = (uint)carry;
        if ((uint)carry != 0u) length = i + 1;
        carry >>= 32;
    }
    return length;
}

// *r = *r + sign * a * b; r is neither of them. Only limbs that matter are multiplied: n is that of the largest result,
// which is far longer than most factors. Column by column, so that nothing waits for a store or a carry within a
// column: a GPU runs the few rays that come here at its latency.
RARE void integer_add_product(Integer* r, const Integer* a, const Integer* b, int sign, int n) {
    Integer x, y;
    const int x_length = integer_magnitude(a, &x, &sign, n), y_length = integer_magnitude(b, &y, &sign, n);
    if (x_length == 0 || y_length == 0) return;
    const uint flip = sign < 0 ? 0xffffffffu : 0u;
    // Sums of the lower and of the upper words of a column's products, the former with what is carried from the columns
    // before.
    ulong column = 0, next = 0;
    ulong carry = flip & 1u;
#pragma unroll 1
    for (int k = 0; k < n; k++) {
        const int end = k < x_length ? k + 1 : x_length;
#pragma unroll 1
        for (int i = k < y_length ? 0 : k - y_length + 1; i < end; i++) {
            const ulong product = (ulong)x.limb[i] * y.limb[k - i];
            column += (uint)product;
            next += product >> 32;
        }
        carry += (ulong)r->limb[k] + ((uint)column ^ flip);
        r->limb[k] = (uint)carry;
        carry >>= 32;
        column = (column >> 32) + next;
        next = 0;
    }
}

// Position of the highest bit of a >= 0, counted from 1; 0 for zero.
int integer_bits(const Integer* a, int n) {
#pragma unroll 1
    for (int i = n - 1; i >= 0; i--)
        if (a->limb[i] != 0u) return 32 * (i + 1) - (int)clz(a->limb[i]);
    return 0;
}

// *a = a * 2^shift for shift >= 0. Without a shift of two words at once, for which Oclgrind knows no function.
RARE void integer_shift_up(Integer* a, int shift, int n) {
    const int limbs = shift / 32, bits = shift % 32;
#pragma unroll 1
    for (int i = n - 1; i >= 0; i--) a->limb[i] = i >= limbs ? a->limb[i - limbs] : 0u;
    ulong carry = 0;
#pragma unroll 1
    for (int i = 0; i < n; i++) {
        carry += (ulong)a->limb[i] << bits;
        a->limb[i] = (uint)carry;
        carry >>= 32;
    }
}

// The float's significand as an integer, and *exponent with |x| = significand * 2^exponent; x is finite.
uint float_significand(float x, int* exponent) {
    const uint bits = as_uint(x);
    const uint field = (bits >> 23) & 255u;
    *exponent = (int)(field == 0u ? 1u : field) - 150;
    return (bits & 0x7fffffu) | (field == 0u ? 0u : 0x800000u);
}

// Widens *lowest..*highest to the exponents of the lowest and behind the highest bit of x; zero has none.
void widen_exponents(float x, int* lowest, int* highest) {
    int exponent;
    const uint significand = float_significand(x, &exponent);
    if (significand == 0u) return;
    const int trailing = 31 - (int)clz(significand & (0u - significand));
    const int low = exponent + trailing, high = exponent + 32 - (int)clz(significand);
    *lowest = low < *lowest ? low : *lowest;
    *highest = high > *highest ? high : *highest;
}

void widen_exponents3(float3 v, int* lowest, int* highest) {
    widen_exponents(v.x, lowest, highest);
    widen_exponents(v.y, lowest, highest);
    widen_exponents(v.z, lowest, highest);
}

// *r = x / 2^exponent; bits below 1 are dropped.
RARE void integer_from_float(Integer* r, float x, int exponent, int n) {
    int own;
    uint significand = float_significand(x, &own);
    integer_set_zero(r, n);
    if (significand == 0u) return;
    int shift = own - exponent;
    if (shift < 0) {
        significand = shift > -32 ? significand >> -shift : 0u;
        shift = 0;
    }
    r->limb[0] = significand;
    integer_shift_up(r, shift, n);
    if (as_uint(x) >> 31) {
        Integer positive = *r;
        integer_set_zero(r, n);
        integer_add(r, &positive, -1, n);
    }
}

// significand * 2^exponent, which must be a float; significand up to 2^24.
float float_from_parts(uint significand, int exponent) {
    const int lift = exponent < -102 ? 24 : 0; // a power of two of its own would be subnormal
    return (float)significand * as_float((uint)(exponent + lift + 127) << 23) * (lift != 0 ? 0x1p-24f : 1.0f);
}

// The float nearest to numerator / denominator * 2^exponent, ties to even; infinity where there is none. n limbs hold
// either with two bits to spare. The numbers are used up.
RARE float integer_quotient(Integer* numerator, Integer* denominator, int exponent, int n) {
    const int sign = integer_take_sign(numerator, n) * integer_take_sign(denominator, n);
    if (sign == 0) return 0.0f;
    // Brought to the same number of bits, and divided bit by bit to 25 or 26 bits: two more than a float has.
    const int denominator_bits = integer_bits(denominator, n), numerator_bits = integer_bits(numerator, n);
    const int scale = denominator_bits - numerator_bits;
    n = (max(denominator_bits, numerator_bits) + 2 + 31) / 32;
    if (scale >= 0) {
        integer_shift_up(numerator, scale, n);
    } else {
        integer_shift_up(denominator, -scale, n);
    }
    uint quotient = 0;
#pragma unroll 1
    for (int i = 0; i < 26; i++) {
        quotient <<= 1;
        integer_add(numerator, denominator, -1, n);
        if (integer_is_negative(numerator, n)) {
            integer_add(numerator, denominator, 1, n);
        } else {
            quotient |= 1u;
        }
        integer_add(numerator, numerator, 1, n);
    }
    const bool is_inexact = !integer_is_zero(numerator, n);
    // quotient * 2^unit with the bits below the float's last one dropped; subnormal floats have fewer.
    const int bits = 32 - (int)clz(quotient);
    const int unit = exponent - scale - 25;
    const int dropped = max(bits - 24, -149 - unit);
    if (dropped > 27) return 0.0f;
    if (unit + bits > 129) return sign > 0 ? INFINITY : -INFINITY;
    uint significand = quotient >> dropped;
    const uint rest = quotient - (significand << dropped);
    const uint half_unit = 1u << (dropped - 1);
    if (rest > half_unit || (rest == half_unit && (is_inexact || (significand & 1u)))) significand++;
    return (sign < 0 ? -1.0f : 1.0f) * float_from_parts(significand, unit + dropped);
}
