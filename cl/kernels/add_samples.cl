// Adds the radiances of samples that were apart to the pixels, in the order of their numbers. Items: pixels.
__kernel void add_samples(__global const RenderParams* restrict render, __global const float4* restrict radiances,
                          __global float4* restrict film, const uint first_sample, const uint end_sample,
                          const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint2 pixel = pixel_of_item(render, item);
    if (!is_in_film(render, pixel)) return;
    const uint apart = items_of_pixel(render, first_sample, end_sample);
    float3 sum = first_sum(render, film, pixel, first_sample, 1u);
    for (uint i = 0; i < apart; i++) sum += radiances[(item * apart + i) % render->samples_apart].xyz;
    store_sum(render, film, item, 1u, end_sample, sum);
}
