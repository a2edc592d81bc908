// Procedural textures: colours computed from the position instead of looked up (thesis, section 5.2.2).
//
// Peachey, "Solid Texturing of Complex Surfaces", SIGGRAPH 1985: an object is cut from a pattern in space, here
// checker, wood and marble. Perlin, "An Image Synthesizer", SIGGRAPH 1985: noise, turbulence and the marble made of
// them; the noise itself is that of "Improving Noise", SIGGRAPH 2002, with a hash of the cell's whole numbers in place
// of the table of permutations.
//
// Needs no memory and no coordinates on the surface. Has no pattern filter: what is finer than a pixel is left to the
// samples.

// The cell of width 1 that holds x, and where in it x is (0..1). A number without a fraction that an int could hold, an
// infinity or NaN counts as the corner of cell 0, so that no conversion is ever out of range.
float split_cell(float x, uint* cell) {
    const float low = floor(x);
    const bool in_range = fabs(low) < CELL_LIMIT;
    *cell = in_range ? (uint)(int)low : 0u;
    return in_range ? x - low : 0.0f;
}

// 32 well mixed bits for a cell. Cells wrap around at 2^32.
uint hash_cell(uint x, uint y, uint z, uint seed) {
    return mix_bits((x * HASH_X) ^ (y * HASH_Y) ^ (z * HASH_Z) ^ (seed * HASH_SEED));
}

// (x, y, z) times one of the twelve vectors from a cube's centre to its edges; four of them are chosen twice as often.
float along_gradient(uint hash, float x, float y, float z) {
    const uint g = hash & 15u;
    const float a = g < 8u ? x : y;
    const float b = g < 4u ? y : (g == 12u || g == 14u ? x : z);
    return ((g & 1u) != 0u ? -a : a) + ((g & 2u) != 0u ? -b : b);
}

// Perlin's 6t^5 - 15t^4 + 10t^3: first and second derivatives vanish at 0 and 1.
float fade(float t) { return t * t * t * fma(t, fma(t, 6.0f, -15.0f), 10.0f); }

float mix_fixed(float a, float b, float t) { return fma(b - a, t, a); }

// Gradient noise in about -1..1 (1.0364 is the most that any choice of gradients gives), 0 at every corner of a cell.
float gradient_noise(float3 p, uint seed) {
    uint x, y, z;
    const float fx = split_cell(p.x, &x), fy = split_cell(p.y, &y), fz = split_cell(p.z, &z);
    const float gx = fx - 1.0f, gy = fy - 1.0f, gz = fz - 1.0f;
    const float s = fade(fx), t = fade(fy);
    const float low = mix_fixed(mix_fixed(along_gradient(hash_cell(x, y, z, seed), fx, fy, fz),
                                          along_gradient(hash_cell(x + 1u, y, z, seed), gx, fy, fz), s),
                                mix_fixed(along_gradient(hash_cell(x, y + 1u, z, seed), fx, gy, fz),
                                          along_gradient(hash_cell(x + 1u, y + 1u, z, seed), gx, gy, fz), s), t);
    const float high = mix_fixed(mix_fixed(along_gradient(hash_cell(x, y, z + 1u, seed), fx, fy, gz),
                                           along_gradient(hash_cell(x + 1u, y, z + 1u, seed), gx, fy, gz), s),
                                 mix_fixed(along_gradient(hash_cell(x, y + 1u, z + 1u, seed), fx, gy, gz),
                                           along_gradient(hash_cell(x + 1u, y + 1u, z + 1u, seed), gx, gy, gz), s), t);
    return mix_fixed(low, high, fade(fz));
}

// Octaves of noise, each of double frequency and half strength; `folded`: of their absolute values, Perlin's
// turbulence.
//
// OCTAVE_SHIFT moves the octaves against each other and against the axes, so that their corners, where all noise is 0,
// do not meet in planes with whole coordinates, where floors and walls like to be. Powers of 0.8192, the root of r^4 +
// r = 1: the additive sequence of least discrepancy in three dimensions (Roberts 2018).
float fractal_noise(float3 p, uint octaves, uint seed, bool folded) {
    float sum = 0.0f, weight = 1.0f;
    for (uint octave = 0; octave < octaves; octave++) {
        p += OCTAVE_SHIFT;
        const float noise = gradient_noise(p, seed + octave);
        sum = fma(weight, folded ? fabs(noise) : noise, sum);
        weight *= 0.5f;
        p *= 2.0f;
    }
    return sum;
}

// Where between the two colours (0..1) the point p of the texture's own space is.

// Cubes of edge 1, by turns.
float checker_pattern(float3 p) {
    uint x, y, z;
    split_cell(p.x, &x);
    split_cell(p.y, &y);
    split_cell(p.z, &z);
    return (float)((x + y + z) & 1u);
}

float noise_pattern(float3 p, uint octaves, uint seed) {
    return clamp01(fma(0.5f, fractal_noise(p, octaves, seed, false), 0.5f));
}

// Veins across x, one in each unit, that turbulence has folded. The fourth power makes them narrower than the stone
// between.
float marble_pattern(float3 p, uint octaves, uint seed, float turbulence) {
    const float layer = fma(turbulence, fractal_noise(p, octaves, seed, true), p.x);
    const float wave = clamp01(fma(0.5f, sin_turns(layer), 0.5f));
    return (wave * wave) * (wave * wave);
}

// Rings about the axis y, one in each unit, that noise has bent. EARLY_WOOD is a ring's share that darkens gradually;
// the late wood ends sharply. WOOD_NOISE makes the noise that bends the rings as wide as four of them and eight times
// as long along the trunk.
float wood_pattern(float3 p, uint octaves, uint seed, float turbulence) {
    const float radius = sqrt(fma(p.x, p.x, p.z * p.z));
    uint ring;
    const float at = split_cell(fma(turbulence, fractal_noise(p * WOOD_NOISE, octaves, seed, false), radius), &ring);
    const float t = clamp01(at < EARLY_WOOD ? at * (1.0f / EARLY_WOOD) : (1.0f - at) * (1.0f / (1.0f - EARLY_WOOD)));
    return t * t * fma(-2.0f, t, 3.0f);
}

float apply_row(float4 row, float3 p) { return fma(p.x, row.x, fma(p.y, row.y, fma(p.z, row.z, row.w))); }

// The colour of a procedural texture at a position in tracing space; or at texture coordinates, where it asks for
// these.
float3 procedural_colour(const TextureInfo* info, float u, float v, float3 position) {
    const float3 at = info->in_uv != 0u ? (float3)(u, v, 0.0f) : position;
    const float3 p = (float3)(apply_row(info->to_x, at), apply_row(info->to_y, at), apply_row(info->to_z, at));
    const float turbulence = info->colour0_turbulence.w;
    float t;
    if (info->kind == TEXTURE_CHECKER) t = checker_pattern(p);
    else if (info->kind == TEXTURE_NOISE) t = noise_pattern(p, info->octaves, info->seed);
    else if (info->kind == TEXTURE_MARBLE) t = marble_pattern(p, info->octaves, info->seed, turbulence);
    else t = wood_pattern(p, info->octaves, info->seed, turbulence);
    const float3 colour = info->colour0_turbulence.xyz;
    return fma3(info->colour1.xyz - colour, t, colour);
}

// Where a solid texture is looked at: beneath the surface by twice six roundings of the triangle's largest coordinate:
// the position's own and those of whoever placed wall and pattern. A wall that lies in a border of the checker's cells
// would else show both of them in the pattern of its rounding errors; so it shows the cell of its inside, also when
// border and wall agree but for a few roundings.
float3 solid_position(const Surface* surface) {
    const float3 outward = surface->front ? surface->geometric_normal : -surface->geometric_normal;
    return fma3(outward, -SOLID_DEPTH * surface->largest_coordinate, surface->point.position);
}
