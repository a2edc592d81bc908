// What a file that is written for any number of lanes is compiled for next: sixteen numbers at a time, one of each ray
// of a packet. Its names end in 16.
#undef REAL
#undef MASK
#undef FACTOR
#undef LANES
#define REAL float16
#define FACTOR float16
#define MASK int16
#define LANES(name) name##16

// Whether any lane of a comparison is true.
bool is_any16(int16 comparison) {
    const ulong2 words = as_ulong2(convert_char16(comparison));
    return (words.x | words.y) != 0ul;
}
#define ALL_LANES16 0x1111111111111111ul
// Lanes as bits of one word: lane i below 8 is bit 8 i, lane 8 + i is bit 8 i + 4. By the lowest bits: Oclgrind makes 1
// of what is true, not -1, where it is not used in the same function.
ulong lanes_where16(int16 comparison) {
    const ulong2 words = as_ulong2(convert_char16(comparison));
    return (words.x & ALL_LANES8) | (words.y & ALL_LANES8) << 4;
}
// And back.
int16 mask_of_lanes16(ulong lanes) {
    return (int16)(convert_int8(as_uchar8(lanes & ALL_LANES8)), convert_int8(as_uchar8(lanes >> 4 & ALL_LANES8))) != 0;
}
// The number of each lane; and one alone.
#define NUMBERS16 ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
int16 only_lane16(uint lane) { return NUMBERS16 == (int)lane; }
ulong lane_bit16(uint lane) { return 1ul << (8u * (lane % 8u) + 4u * (lane / 8u)); }
// The lowest bit's lane, and how many there are. The others: other_lanes8().
uint first_lane16(ulong lanes) {
    const uint bit = lowest_bit(lanes);
    return bit / 8u + 2u * (bit & 4u);
}
uint count_lanes16(ulong lanes) { return count_lanes8((lanes & ALL_LANES8) + (lanes >> 4 & ALL_LANES8)); }

void set_lane16(float16* v, uint lane, float x) { ((float*)v)[lane] = x; }
