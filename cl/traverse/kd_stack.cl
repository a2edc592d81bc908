// kd-tree traversal with a full stack of far children.
// Havran, "Heuristic Ray Shooting Algorithms", PhD thesis, Czech Technical University 2000, appendix C; thesis, section 5.6.
//
// No step is repeated, at the price of a stack in private memory (12 bytes a level), which costs registers or local memory on
// a GPU.
//
// Differs from the thesis's listing 5.2 where that one loses hits: the children are ordered by the sign of the direction, so a
// plane behind the ray's start (t_split < 0) leaves only the SECOND child, and every t of a plane is widened by its rounding
// error in both directions. A ray that runs in a plane has t_split = 0 * infinity = NaN: all comparisons fail and both
// children are visited with the whole interval.

#ifndef STACK_SIZE
#define STACK_SIZE 64 // at least the depth of the tree; the host knows it
#endif

typedef struct {
    uint node;
    float t_near, t_far;
} FarChild;

float component(float3 v, uint axis) { return axis == 0u ? v.x : axis == 1u ? v.y : v.z; }

bool traverse_kd_stack(const Geometry* geometry, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit();
    float t_near, t_far;
    if (!clip_to_box(ray, geometry->low, geometry->high, &t_near, &t_far)) return false;

    FarChild stack[STACK_SIZE];
    uint stacked = 0;
    uint node_index = 0;
    while (true) {
        // Descend to the first leaf of the interval, and remember the far children.
        int4 node = LOAD_NODE(geometry, node_index);
        while ((uint)node.x != KD_LEAF) {
            const uint axis = (uint)node.x;
            const float inv_direction = component(ray->inv_direction, axis);
            const float t_split = (as_float(node.w) - component(ray->origin, axis)) * inv_direction;
            const bool ascending = component(ray->direction, axis) >= 0.0f;
            const uint first = (uint)(ascending ? node.y : node.z);
            const uint second = (uint)(ascending ? node.z : node.y);
            const float t_split_low = widen_down(t_split);
            const float t_split_high = widen_up(t_split);
            if (t_split_low > t_far) {
                node_index = first;
            } else if (t_split_high < t_near) {
                node_index = second;
            } else {
                stack[stacked].node = second;
                stack[stacked].t_near = max_or(t_split_low, t_near);
                stack[stacked].t_far = t_far;
                stacked++;
                node_index = first;
                t_far = min_or(t_split_high, t_far);
            }
            node = LOAD_NODE(geometry, node_index);
        }

        const uint end = (uint)node.y + (uint)node.z;
        for (uint i = (uint)node.y; i < end; i++) {
            test_triangle(geometry, ray, LOAD_REFERENCE(geometry, i), hit);
            if (any_hit && hit->primitive != NO_PRIMITIVE) return true;
        }

        // Go on with the nearest remembered cell. One that starts behind the hit cannot hold a nearer one.
        do {
            if (stacked == 0) return hit->primitive != NO_PRIMITIVE;
            stacked--;
        } while (hit->t < stack[stacked].t_near);
        node_index = stack[stacked].node;
        t_near = stack[stacked].t_near;
        t_far = stack[stacked].t_far;
    }
}
