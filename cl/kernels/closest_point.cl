// Point queries: which triangles may be the nearest one of a point. A work-item takes a point and goes down a binary
// hierarchy of boxes (src/accel/bvh2.rs) twice, nearer boxes first. The first time it looks for a distance within which
// there surely is a triangle; the second time it lists all triangles that may be within it. Mostly that is one
// triangle, or those around one edge or vertex; the host decides among them exactly (src/closest.rs). So the answer
// does not depend on this kernel's roundings, as long as the bounds below hold.
//
// Roussopoulos, Kelley and Vincent, "Nearest Neighbor Queries", SIGMOD 1995 (depth first, nearer boxes first, boxes
// farther than the best so far left out); Ericson, "Real-Time Collision Detection", 2005, section 5.1.5 (the closest
// point of a triangle).
//
// A distance is held between two bounds that hold however wrong the computed closest point is. Corners are a, b, c from
// the point as the origin; `reach` is the length of the longest of them, e stands for EPSILON.
// * From above: the length of any point q = a + s (b - a) + t (c - a) of the triangle. Rounding moves q by at most
//   5 e reach. u and v of a face may add up to 1 + 7.1 e, which moves q out of the triangle by 14.2 e reach. The length
//   is off by 8.5 e reach, with a square root that is off by 3 units in the last place, and the sum by e. In all 28.7 e
//   reach.
// * From below: for any direction d the triangle lies beyond the plane at min(a.d, b.d, c.d) / |d|. A product is off by
//   4.1 e reach |d|, the length of d and the division by 12.5 e at most. In all 16.6 e reach, and e for the sum.
// DISTANCE_ERROR is 32 e. LEAST_DISTANCE_ERROR is for all that gets lost below 2^-126: products, and the lowest bits of
// coordinates on their way to tracing space.
//
// Bad at: points that are as far from very many triangles, such as the centre of a sphere, and points far away: their
// lists are longer than MOST_CANDIDATES, and then the host makes them.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // more than the depth of every hierarchy
#endif

// The closest point of a triangle so far, from the query's point as the origin.
typedef struct {
    float3 to;
    float square;   // of its distance
    float3 along;   // the edge that it is inside of, the face's normal, or 0
    bool is_inside; // whether it is inside of the face
} Nearest;

// Takes the closest point of the edge from `from` on if it is nearer.
void take_edge(float3 from, float3 edge, Nearest* nearest) {
    const float s = clamp01(-dot3(from, edge) / dot3(edge, edge)); // any s will do for an edge without length
    const float3 to = fma3(edge, s, from);
    const float square = dot3(to, to);
    if (!(square < nearest->square)) return;
    nearest->to = to;
    nearest->square = square;
    nearest->along = edge * (s > 0.0f && s < 1.0f ? 1.0f : 0.0f);
}

// A point of the triangle that is about the closest one.
Nearest nearest_of_triangle(float3 a, float3 b, float3 c) {
    const float3 edge1 = b - a, edge2 = c - a;
    Nearest nearest = {a, dot3(a, a), (float3)(0.0f), false};
    take_edge(a, edge1, &nearest);
    take_edge(a, edge2, &nearest);
    take_edge(b, c - b, &nearest);

    const float3 normal = cross3(edge1, edge2);
    const float weight0 = dot3(normal, cross3(b, c));
    const float weight1 = dot3(normal, cross3(c, a));
    const float weight2 = dot3(normal, cross3(a, b));
    const float sum = (weight0 + weight1) + weight2;
    if (!(weight0 >= 0.0f && weight1 >= 0.0f && weight2 >= 0.0f && sum > 0.0f)) return nearest;
    const float3 to = fma3(edge2, weight2 / sum, fma3(edge1, weight1 / sum, a));
    const float square = dot3(to, to);
    if (!(square <= nearest.square)) return nearest;
    const Nearest in_face = {to, square, normal, true};
    return in_face;
}

// What bounds of the triangle's distance are off by.
float distance_error(float3 a, float3 b, float3 c) {
    const float reach = sqrt(max_or(dot3(a, a), max_or(dot3(b, b), dot3(c, c))));
    return fma(DISTANCE_ERROR, reach, LEAST_DISTANCE_ERROR);
}

// A bound from above of the distance.
float farthest_distance(float3 a, float3 b, float3 c) {
    const Nearest nearest = nearest_of_triangle(a, b, c);
    return sqrt(nearest.square) + distance_error(a, b, c);
}

// A bound from below of the distance; negative where little is known. Of a point inside of a face or an edge the
// direction to it is mostly rounding where it is near: the face's normal is taken in its place, and what of the
// direction is along the edge is taken out.
float least_distance(float3 a, float3 b, float3 c) {
    const Nearest nearest = nearest_of_triangle(a, b, c);
    float3 direction = nearest.to;
    const float along = dot3(nearest.to, nearest.along);
    if (nearest.is_inside) {
        direction = nearest.along * (along < 0.0f ? -1.0f : 1.0f);
    } else {
        const float square = dot3(nearest.along, nearest.along);
        if (square > 0.0f) direction = fma3(nearest.along, -(along / square), nearest.to);
    }
    float scale = 1.0f;
    if (!scale_to_unit(&direction, &scale)) return 0.0f;
    const float least = min_or(dot3(a, direction), min_or(dot3(b, direction), dot3(c, direction)));
    return least / sqrt(dot3(direction, direction)) - distance_error(a, b, c);
}

// The square of a distance that is no larger than that to a box, but for 5.1 EPSILON of itself: limit_of() makes up for
// that. The box is given by its middle and half of its size.
float box_square(float3 point, float3 middle, float3 half_size) {
    const float3 away = abs3(point - middle) * BOX_DISTANCE_DOWN - half_size;
    const float3 outside = (float3)(max_or(away.x, 0.0f), max_or(away.y, 0.0f), max_or(away.z, 0.0f));
    return dot3(outside, outside);
}

// Boxes whose box_square() is larger are farther than `distance`.
float limit_of(float distance) { return distance * distance * BOX_LIMIT_UP; }

typedef struct {
    __global const int4* nodes;
    __global const uint* references;
    __global const float4* vertices;
} PointScene;

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
            const float3 a = scene->vertices[3u * primitive].xyz - point;
            const float3 b = scene->vertices[3u * primitive + 1u].xyz - point;
            const float3 c = scene->vertices[3u * primitive + 2u].xyz - point;
            if (!lists) {
                *distance = min_or(*distance, farthest_distance(a, b, c));
                limit = limit_of(*distance);
            } else if (least_distance(a, b, c) <= *distance) {
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

// How many triangles may be the nearest one of each point (tracing space; none for NaN), and the first MOST_CANDIDATES
// of them.
__kernel void list_candidates(__global const int4* restrict nodes, __global const uint* restrict references,
                              __global const float4* restrict vertices, __global const float4* restrict points,
                              __global uint* restrict counts, __global uint* restrict candidates, const uint first,
                              const uint end) {
    const uint index = first + (uint)get_global_id(0);
    if (index >= end) return;
    const float3 point = points[index].xyz;
    counts[index] = 0u;
    if (!is_finite3(point)) return;
    const PointScene scene = {nodes, references, vertices};
    float distance = INFINITY;
    (void)visit_triangles(&scene, point, &distance, 0, false);
    counts[index] = visit_triangles(&scene, point, &distance, candidates + (ulong)MOST_CANDIDATES * index, true);
}
