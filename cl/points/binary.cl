// Point queries in a hierarchy of two children a node (src/accel/bvh2.rs), one box and one triangle after the other:
// for GPUs.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // more than the depth of every hierarchy
#endif

// The square of a distance that is no larger than that to a box, but for 5.1 EPSILON of itself: limit_of() makes up for
// that. The box is given by its middle and half of its size.
float box_square(float3 point, float3 middle, float3 half_size) {
    const float3 away = abs3(point - middle) * BOX_DISTANCE_DOWN - half_size;
    const float3 outside = (float3)(max_or(away.x, 0.0f), max_or(away.y, 0.0f), max_or(away.z, 0.0f));
    return dot3(outside, outside);
}

// Goes through all leaves that may be within *distance, nearer ones first. Without a list *distance becomes a distance
// within which there surely is a triangle. With one all triangles that may be within *distance are counted, and the
// first MOST_CANDIDATES of them are listed.
uint visit_triangles(const PointScene* scene, float3 point, float* distance, __global uint* list, const bool lists) {
    uint links[STACK_SIZE];
    float squares[STACK_SIZE];
    uint stacked = 0u, link = 0u, count = 0u;
    float limit = limit_of(*distance);
    while (true) {
        while ((link & BVH_LEAF) == 0u) {
            const uint first = BVH_NODE_RECORDS * link;
            const float4 xy0 = as_float4(scene->nodes[first]), xy1 = as_float4(scene->nodes[first + 1u]);
            const int4 z0 = scene->nodes[first + 2u];
            const float4 z1 = as_float4(scene->nodes[first + 3u]);
            const float square0 = box_square(point, (float3)(xy0.xz, as_float(z0.z)), (float3)(xy0.yw, as_float(z0.w)));
            const float square1 = box_square(point, (float3)(xy1.xz, z1.x), (float3)(xy1.yw, z1.y));
            const bool goes_to1 = square1 < square0;
            const float near = goes_to1 ? square1 : square0, far = goes_to1 ? square0 : square1;
            if (far <= limit) {
                links[stacked] = (uint)(goes_to1 ? z0.x : z0.y);
                squares[stacked++] = far;
            }
            link = near <= limit ? (uint)(goes_to1 ? z0.y : z0.x) : BVH_LEAF; // a leaf of no triangles
        }
        const uint end = (link & BVH_FIRST_MASK) + ((link & ~BVH_LEAF) >> BVH_COUNT_SHIFT);
        for (uint i = link & BVH_FIRST_MASK; i < end; i++) {
            const uint primitive = scene->references[i];
            const Vector a = vector_of(scene->triangles[3u * primitive].xyz - point);
            const Vector b = vector_of(scene->triangles[3u * primitive + 1u].xyz - point);
            const Vector c = vector_of(scene->triangles[3u * primitive + 2u].xyz - point);
            if (!lists) {
                *distance = smaller(farthest_distance(a, b, c), *distance);
                limit = limit_of(*distance);
            } else if (may_be_within(a, b, c, *distance)) {
                if (count < MOST_CANDIDATES) list[count] = primitive;
                count++;
            }
        }
        do {
            if (stacked == 0u) return count;
            link = links[--stacked];
        } while (squares[stacked] > limit);
    }
}
