// What a file that is written for any number of lanes is compiled for next: eight numbers at a time, in vectors. Its
// names end in 8. MASK: the type of a comparison.
#undef ONE_LANE
#undef REAL
#undef MASK
#undef LANES
#define REAL float8
#define MASK int8
#define LANES(name) name##8

// All lanes, and the first `count`, of which there is at least one.
#define ALL_LANES8 0x0101010101010101ul
#define FIRST_LANES8(count) (ALL_LANES8 >> (8u * (8u - (count))))
// All bits of them, which are of several packets.
#define FIRST_BYTES8(count) (~0ul >> (8u * (8u - (count))))
// Bit 8 i: whether lane i of a comparison is true.
ulong lanes_where8(int8 comparison) { return as_ulong(convert_char8(comparison)) & ALL_LANES8; }
bool is_any8(int8 comparison) { return as_ulong(convert_char8(comparison)) != 0ul; }
// How many lanes some are. Not popcount(), which Oclgrind does not know.
uint count_lanes8(ulong lanes) { return (uint)((lanes * 0x0101010101010101ul) >> 56); }
// The number of the lowest bit of some; of none it is not defined.
uint lowest_bit(ulong bits) { return 63u - (uint)clz(bits & (0ul - bits)); }
// The highest lane of some.
uint last_lane8(ulong lanes) { return (63u - (uint)clz(lanes)) / 8u; }
// The lowest lane of some, whether it is the only one, and the others.
uint first_lane8(ulong lanes) { return lowest_bit(lanes) / 8u; }
bool is_only_lane8(ulong lanes, uint first) { return lanes >> (8u * first) == 1ul; }
ulong other_lanes8(ulong lanes) { return lanes & (lanes - 1ul); }

bool is_lane8(ulong lanes, uint lane) { return (lanes >> (8u * lane) & 1ul) != 0ul; }
