// Textures: pictures of 8-bit sRGB texels, repeated, filtered in linear light; or procedural ones.

// Texel coordinate of wrapped texture coordinate `t` on a side of `size` texels: *low and *high are the two texels
// around it, the result is the weight of *high. Coordinates without a number, as NaN and infinite ones in a file or
// huge ones between which no sum is a number, become 0; from 2^24 on all are whole numbers, so 0, too.
float wrap_texel(float t, uint size, uint* low, uint* high) {
    const float wrapped = is_finite(t) ? t - floor(t) : 0.0f; // in 0..1; 1 only by rounding
    const float x = fma(wrapped, (float)size, -0.5f);
    const float floor_x = floor(x);
    const int index = (int)floor_x; // -1 .. size
    const int last = (int)size - 1;
    *low = (uint)(index < 0 ? last : index > last ? 0 : index);
    *high = *low == (uint)last ? 0u : *low + 1u;
    return x - floor_x;
}

float3 texel(__global const uint* texels, __global const float* srgb_to_linear, uint index) {
    const uint rgba = texels[index];
    return (float3)(srgb_to_linear[rgba & 255u], srgb_to_linear[(rgba >> 8) & 255u],
                    srgb_to_linear[(rgba >> 16) & 255u]);
}

// A level of a texture; each is half as wide and as high as the one before, rounded down.
typedef struct {
    uint first;
    uint width;
    uint height;
} TextureLevel;

TextureLevel next_level(TextureLevel level) {
    const TextureLevel next = {level.first + level.width * level.height, max(level.width >> 1, 1u),
                               max(level.height >> 1, 1u)};
    return next;
}

// Bilinear.
float3 sample_level(const TextureLevel* level, __global const uint* texels, __global const float* srgb_to_linear,
                    float u, float v) {
    uint left, right, top, bottom;
    const float weight_x = wrap_texel(u, level->width, &left, &right);
    const float weight_y = wrap_texel(-v, level->height, &top, &bottom); // v runs upwards, rows downwards
    const uint row0 = level->first + top * level->width;
    const uint row1 = level->first + bottom * level->width;
    const float3 c00 = texel(texels, srgb_to_linear, row0 + left), c01 = texel(texels, srgb_to_linear, row0 + right);
    const float3 c10 = texel(texels, srgb_to_linear, row1 + left), c11 = texel(texels, srgb_to_linear, row1 + right);
    const float3 upper = fma3(c01 - c00, weight_x, c00);
    const float3 lower = fma3(c11 - c10, weight_x, c10);
    return fma3(lower - upper, weight_y, upper);
}

// Mean of `taps` places, evenly spread over `way` about (u, v).
float3 sample_along(const TextureLevel* level, __global const uint* texels, __global const float* srgb_to_linear,
                    float u, float v, float2 way, uint taps) {
    const float share = 1.0f / (float)taps;
    float3 sum = (float3)(0.0f);
    for (uint i = 0; i < taps; i++) {
        const float at = fma((float)i + 0.5f, share, -0.5f);
        sum += sample_level(level, texels, srgb_to_linear, fma(way.x, at, u), fma(way.y, at, v));
    }
    return sum * share;
}

// How far an axis of a footprint reaches, in texels of the finest level.
float texels_along(float2 way, const TextureInfo* info) {
    const float x = way.x * (float)info->width, y = way.y * (float)info->height;
    return sqrt(fma(x, x, y * y));
}

// Mean over a footprint: along its longer axis as many places as the shorter one fits into it, at most so many, at a
// level whose texels are as large as the shorter axis, or between two levels (Williams, "Pyramidal Parametrics",
// SIGGRAPH 1983; several places: McCormack et al., "Feline: Fast Elliptical Lines for Anisotropic Texture Mapping",
// SIGGRAPH 1999). Less than a texel: bilinear.
float3 sample_footprint(const TextureInfo* info, __global const uint* texels, __global const float* srgb_to_linear,
                        float u, float v, const Footprint* footprint) {
    const float along = texels_along(footprint->along, info), across = texels_along(footprint->across, info);
    // Else the triangle has no area, or the cone is beyond all numbers: the mean of the whole texture.
    const bool is_known = is_finite(along) && is_finite(across);
    const float2 way = !is_known ? (float2)(0.0f) : along >= across ? footprint->along : footprint->across;
    const float longer = is_known ? max_or(along, across) : 0.0f, shorter = is_known ? min_or(along, across) : 0.0f;
    const uint taps = max(1u, (uint)ceil(min_or(longer / max_or(shorter, 1.0f), (float)MOST_TAPS)));
    // What one place stands for, in texels.
    const float width = is_known ? max_or(max_or(longer / (float)taps, shorter), 1.0f) : MORE_TEXELS;
    // Its logarithm, with straight lines between powers of two.
    const uint level_number = (as_uint(width) >> 23) - 127u;
    const float beyond = as_float((as_uint(width) & 0x7fffffu) | 0x3f800000u) - 1.0f;
    const bool is_last = level_number + 1u >= info->levels;
    TextureLevel level = {info->first, info->width, info->height};
    for (uint i = is_last ? info->levels - 1u : level_number; i > 0u; i--) level = next_level(level);
    const float3 colour = sample_along(&level, texels, srgb_to_linear, u, v, way, taps);
    if (is_last || beyond == 0.0f) return colour;
    level = next_level(level);
    return fma3(sample_along(&level, texels, srgb_to_linear, u, v, way, taps) - colour, beyond, colour);
}

// The colour of a texture on a surface: at texture coordinates u, v for a picture, at `position` (see solid_position())
// for a procedural texture. Everything that a texture's colour depends on is an argument.
float3 surface_colour(__global const TextureInfo* textures, __global const uint* texels,
                      __global const float* srgb_to_linear, uint texture, float u, float v, const Footprint* footprint,
                      float3 position) {
    const TextureInfo info = textures[texture];
    if (HAS(FEATURE_PROCEDURAL_TEXTURES) && (!HAS(FEATURE_IMAGE_TEXTURES) || info.kind != TEXTURE_IMAGE))
        return procedural_colour(&info, u, v, position);
    if (HAS_CONES) return sample_footprint(&info, texels, srgb_to_linear, u, v, footprint);
    const TextureLevel finest = {info.first, info.width, info.height};
    return sample_level(&finest, texels, srgb_to_linear, u, v);
}
