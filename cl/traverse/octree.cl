// Octree: every cell is divided at its centre into eight.
// Glassner, "Space Subdivision for Fast Ray Tracing", IEEE Computer Graphics and Applications 4(10), 1984; thesis,
// section 2.2.3. The order of the children is that of Revelles, Urena and Lastra, "An Efficient Parametric Algorithm
// for Octree Traversal", WSCG 2000: mirrored by the signs of the direction.
//
// Adapts to where the triangles are, which the grid does not, but its planes know nothing of them: a kd-tree by surface
// areas needs fewer steps and references. One entry of the stack for each level.
//
// nodes: an inner node is {0, first of its 8 children, its centre's index in bounds, 0}; bit 0, 1, 2 of a child's
// number: above the centre in x, y, z. A leaf is as in the kd-tree. bounds: {low corner of the root, first of the
// references of triangles that are outside of it}, {high corner, how many these are}, centres. A cell reaches to its
// planes and, at the rim, without end.
//
// The three planes are widened by the ray's own slack (cl/shared/ray.cl): the point of a hit is within it of a point of
// its triangle, that point lies in some leaf that lists the triangle, and so the hit's t is within the computed
// interval of that leaf and of all cells above it.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // at least the depth of the tree; the host knows it
#endif

typedef struct {
    uint first_child, centre;
    uint next; // child to visit next, 0..8, in the ray's order
    float t_near, t_far;
} OpenNode;

// The part of t_near..t_far in the half of a cell before (or, `beyond`, behind) the plane at distance to_plane from the
// origin.
void clip_to_half(float to_plane, float slack, float direction, float inv_direction, bool beyond, float* t_near,
                  float* t_far) {
    const float outwards = beyond == (direction < 0.0f) ? slack : -slack;
    const float t_plane = (to_plane + outwards) * inv_direction;
    if (beyond) {
        const float t_enter = widen_down(t_plane);
        if (t_enter > *t_near) *t_near = t_enter;
    } else {
        const float t_leave = widen_up(t_plane);
        if (t_leave < *t_far) *t_far = t_leave;
    }
}

bool traverse_octree(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    // Those that reach so far out that all others would be in one cell (src/accel/near.rs): few, and mostly none.
    const float4 low = LOAD_BOUNDS(geometry, 0), high = LOAD_BOUNDS(geometry, 1);
    const uint outside = as_uint(low.w);
    if (test_triangles(GEOMETRY, ray, outside, outside + as_uint(high.w), any_hit, hit)) return true;
    const float slack = SLACK * farthest_distance(ray, low.xyz, high.xyz);
    float t_near, t_far;
    if (!clip_to_thick_box(ray, slack, low.xyz, high.xyz, &t_near, &t_far)) return hit->primitive != NO_PRIMITIVE;
    // A ray towards lower x meets the upper half first, and so on: child i of its order is child i ^ mirror.
    const uint mirror = (ray->direction.x < 0.0f ? 1u : 0u) | (ray->direction.y < 0.0f ? 2u : 0u) |
                        (ray->direction.z < 0.0f ? 4u : 0u);

    OpenNode stack[STACK_SIZE];
    uint depth = 0;
    uint node_index = 0;
    while (true) {
        const int4 node = LOAD_NODE(geometry, node_index);
        if ((uint)node.x == KD_LEAF) {
            if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;
        } else {
            const OpenNode open = {(uint)node.y, (uint)node.z, 0u, t_near, t_far};
            stack[depth] = open;
            depth++;
            COUNT_DEEPEST(geometry, depth);
        }

        // Go on with the next child that the ray meets before the hit. In the ray's order no child comes before one
        // that the ray meets earlier: its bits would be a subset, and its number lower.
        bool found = false;
        while (!found) {
            if (depth == 0) return hit->primitive != NO_PRIMITIVE;
            OpenNode* open = &stack[depth - 1];
            if (open->next == 8u || hit->t < open->t_near) {
                depth--;
                continue;
            }
            const uint child = open->next;
            open->next++;
            COUNT(geometry, STEPS, 1);
            const float3 to_centre = from_origin(ray, LOAD_BOUNDS(geometry, open->centre).xyz);
            t_near = open->t_near;
            t_far = open->t_far;
            clip_to_half(to_centre.x, slack, ray->direction.x, ray->inv_direction.x, child & 1u, &t_near, &t_far);
            clip_to_half(to_centre.y, slack, ray->direction.y, ray->inv_direction.y, child & 2u, &t_near, &t_far);
            clip_to_half(to_centre.z, slack, ray->direction.z, ray->inv_direction.z, child & 4u, &t_near, &t_far);
            found = t_near <= t_far && hit->t >= t_near;
            node_index = open->first_child + (child ^ mirror);
        }
    }
}
