// What the kd-tree's traversals share: one step down.
// Havran, "Heuristic Ray Shooting Algorithms", PhD thesis, Czech Technical University 2000, appendix C; thesis, section
// 5.6.
//
// The children are ordered by the sign of the direction, so a plane behind the ray's start (t_split < 0) leaves only
// the SECOND child, and every t of a plane is widened by its rounding error in both directions. A ray that runs in a
// plane has limits of t_split that are infinite: both children are visited with the whole interval.
//
// All of a cell's t are those of its own six faces, because a computed t never decreases along an axis. So a ray meets
// a leaf by these steps exactly when clip_to_box() of the leaf's box says so, and the intervals of neighbours overlap
// by the widening.

// A node, and the part of the ray in its cell.
typedef struct {
    uint node;
    float t_near, t_far;
} KdCell;

float component(float3 v, uint axis) { return axis == 0u ? v.x : axis == 1u ? v.y : v.z; }

// The children of an inner node in the order in which the ray meets them, and bounds of the plane's t.
typedef struct {
    uint first, second;
    float t_low, t_high;
} KdSplit;

KdSplit kd_split(const Ray* ray, int4 node) {
    const uint axis = (uint)node.x;
    const float to_split = (as_float(node.w) - component(ray->origin, axis)) - component(ray->origin_low, axis);
    const float inv_direction = component(ray->inv_direction, axis);
    const bool ascending = component(ray->direction, axis) >= 0.0f;
    const float outwards = ascending ? PLANE_ERROR : -PLANE_ERROR;
    KdSplit split;
    split.first = (uint)(ascending ? node.y : node.z);
    split.second = (uint)(ascending ? node.z : node.y);
    split.t_low = widen_down((to_split - outwards) * inv_direction);
    split.t_high = widen_up((to_split + outwards) * inv_direction);
    return split;
}

// Goes from the inner node `node` of *cell to the child that the ray meets. If it meets both, goes to the first one,
// writes the second one to *second and returns true.
bool kd_step(const Ray* ray, int4 node, KdCell* cell, KdCell* second) {
    const KdSplit split = kd_split(ray, node);
    if (split.t_low > cell->t_far) {
        cell->node = split.first;
        return false;
    }
    if (split.t_high < cell->t_near) {
        cell->node = split.second;
        return false;
    }
    second->node = split.second;
    second->t_near = max_or(split.t_low, cell->t_near);
    second->t_far = cell->t_far;
    cell->node = split.first;
    cell->t_far = min_or(split.t_high, cell->t_far);
    return true;
}
