// Point queries: which triangles may be the nearest one of a point. A work-item takes a point and goes down a hierarchy
// of boxes twice. The first time it looks for a distance within which there surely is a triangle; the second time it
// lists all triangles that may be within it. Mostly that is one triangle, or those around one edge or vertex; the host
// decides among them exactly (src/closest.rs). So the answer does not depend on this kernel's roundings, as long as the
// bounds of cl/points/distance.cl hold.
//
// Roussopoulos, Kelley and Vincent, "Nearest Neighbor Queries", SIGMOD 1995 (depth first, nearer boxes first, boxes
// farther than the best so far left out).
//
// Bad at: points that are as far from very many triangles, such as the centre of a sphere, and points far away: their
// lists are longer than MOST_CANDIDATES, and then the host makes them.

// How many triangles may be the nearest one of each point (tracing space; none for NaN), and the first MOST_CANDIDATES
// of them.
__kernel void list_candidates(__global const int4* restrict nodes, __global const uint* restrict references,
                              __global const float4* restrict triangles, __global const float4* restrict points,
                              __global uint* restrict counts, __global uint* restrict candidates, const uint first,
                              const uint end) {
    const uint index = first + (uint)get_global_id(0);
    if (index >= end) return;
    const float3 point = points[index].xyz;
    counts[index] = 0u;
    if (!is_finite3(point)) return;
    const PointScene scene = {nodes, references, triangles};
    float distance = INFINITY;
    (void)visit_triangles(&scene, point, &distance, 0, false);
    counts[index] = visit_triangles(&scene, point, &distance, candidates + (ulong)MOST_CANDIDATES * index, true);
}
