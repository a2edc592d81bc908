// What a device can do at most, each alone: arithmetic, reads that a cache serves, and copies from memory to memory.

// 128 operations a round: 64 independent products and sums, of which none is fused, as in all kernels.
__kernel void arithmetic(const uint rounds, const float factor, const float summand, __global float16* sums)
{
    const size_t index = get_global_id(0);
    float16 a = (float16)((float)index);
    float16 b = a + 1.0f, c = a + 2.0f, d = a + 3.0f;
    for (uint round = 0; round < rounds; ++round) {
        a = a * factor + summand;
        b = b * factor + summand;
        c = c * factor + summand;
        d = d * factor + summand;
    }
    sums[index] = (a + b) + (c + d);
}

// All work-items read the same `count` elements, a multiple of 4, in the same order, as brute force reads vertices.
__kernel void cached_reads(const uint rounds, const uint count, __global const float4* elements, __global float4* sums)
{
    float4 a = (float4)(0.0f), b = a, c = a, d = a;
    for (uint round = 0; round < rounds; ++round) {
        for (uint i = 0; i < count; i += 4) {
            a += elements[i];
            b += elements[i + 1];
            c += elements[i + 2];
            d += elements[i + 3];
        }
    }
    sums[get_global_id(0)] = (a + b) + (c + d);
}

__kernel void copy(__global const float4* from, __global float4* to)
{
    to[get_global_id(0)] = from[get_global_id(0)];
}
