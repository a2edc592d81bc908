// Textures: pictures of 8-bit sRGB texels, repeated, bilinear in linear light; or procedural ones.

// Texel coordinate of wrapped texture coordinate `t` on a side of `size` texels: *low and *high are the two texels around it,
// the result is the weight of *high. Coordinates without a number, as NaN and infinite ones in a file or huge ones between which no
// sum is a number, become 0; from 2^24 on all are whole numbers, so 0, too.
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
    return (float3)(srgb_to_linear[rgba & 255u], srgb_to_linear[(rgba >> 8) & 255u], srgb_to_linear[(rgba >> 16) & 255u]);
}

float3 sample_texture(const TextureInfo* info, __global const uint* texels, __global const float* srgb_to_linear, float u,
                      float v) {
    uint left, right, top, bottom;
    const float weight_x = wrap_texel(u, info->width, &left, &right);
    const float weight_y = wrap_texel(-v, info->height, &top, &bottom); // v runs upwards, rows downwards
    const uint row0 = info->first + top * info->width;
    const uint row1 = info->first + bottom * info->width;
    const float3 c00 = texel(texels, srgb_to_linear, row0 + left), c01 = texel(texels, srgb_to_linear, row0 + right);
    const float3 c10 = texel(texels, srgb_to_linear, row1 + left), c11 = texel(texels, srgb_to_linear, row1 + right);
    const float3 upper = fma3(c01 - c00, weight_x, c00);
    const float3 lower = fma3(c11 - c10, weight_x, c10);
    return fma3(lower - upper, weight_y, upper);
}

// The colour of a texture on a surface: at texture coordinates u, v for a picture, at `position` (see solid_position()) for a
// procedural texture. Everything that a texture's colour depends on is an argument.
float3 surface_colour(__global const TextureInfo* textures, __global const uint* texels,
                      __global const float* srgb_to_linear, uint texture, float u, float v, float3 position) {
    const TextureInfo info = textures[texture];
    if (HAS(FEATURE_PROCEDURAL_TEXTURES) && (!HAS(FEATURE_IMAGE_TEXTURES) || info.kind != TEXTURE_IMAGE))
        return procedural_colour(&info, u, v, position);
    return sample_texture(&info, texels, srgb_to_linear, u, v);
}
