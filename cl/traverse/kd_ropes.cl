// Ropes: from each leaf straight to its neighbour, without a stack and without going back to the root.
// Popov, Guenther, Seidel and Slusallek, "Stackless KD-Tree Traversal for High Performance GPU Ray Tracing", Computer
// Graphics Forum 26(3), 2007.
//
// Few steps and few registers. Bad at: memory (48 bytes more a leaf, three reads at each leaf's end), and rays that run
// in a plane, through an edge of cells, or so close to one that rounding hides the order: those are traced again by
// kd_push_down.cl (1 in 1000 on meshes; all that run in planes). On PoCL .7 to .98 of the full stack's speed.
//
// A rope leads to the deepest node that holds all neighbours behind a face (src/accel/ropes.rs); from there planes are
// compared with the t of the face. Every t has an error, so every plane has a band t_low..t_high that holds its true t.
// kd_push_down.cl visits the leaves that some t within all bands allows. This one goes on only while that is a chain of
// single leaves, and else starts over with the hit found so far. The chain is single while bands of planes of DIFFERENT
// axes do not overlap where the ray crosses them:
//  1. the exit face's band lies before those of the leaf's other two exit faces (no neighbour behind these, nor behind
//     the edge);
//  2. and behind the band of the face that was crossed last, if that was on another axis. By 1 that one lies behind all
//     bands crossed before, and along one axis bands never go back, so this compares with all of them;
//  3. planes between a rope's node and the leaf lie, if on another axis than the face, before or behind the face's
//     band. Those on its axis lie behind the face: first child.
// Planes of one axis may be as close as they like, their order is known. At the start of the ray there is nothing
// behind it that could be missed: where its first t is in a plane's band, the first child is taken, and the plane is
// crossed next.

// One axis of a leaf, as src/accel/ropes.rs packs it: {low, high, rope below, rope above}, the ropes' bits being node
// indices. The t at which the ray leaves it, at the earliest (`error` negative) or latest, not widened; infinite when
// it runs along or in its face.
float leave_slab(float4 slab, float origin, float origin_low, float direction, float inv_direction, float error) {
    const float to_plane = ((direction >= 0.0f ? slab.y : slab.x) - origin) - origin_low;
    return (to_plane + (direction >= 0.0f ? error : -error)) * inv_direction;
}
float3 leave_slabs(const Ray* ray, float4 x, float4 y, float4 z, float error) {
    return (float3)(leave_slab(x, ray->origin.x, ray->origin_low.x, ray->direction.x, ray->inv_direction.x, error),
                    leave_slab(y, ray->origin.y, ray->origin_low.y, ray->direction.y, ray->inv_direction.y, error),
                    leave_slab(z, ray->origin.z, ray->origin_low.z, ray->direction.z, ray->inv_direction.z, error));
}

uint rope_ahead(float4 slab, float direction) { return as_uint(direction >= 0.0f ? slab.w : slab.z); }

bool traverse_kd_ropes(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    KdCell root = {0, 0.0f, 0.0f};
    if (!clip_to_box(ray, geometry->low, geometry->high, &root.t_near, &root.t_far)) return false;

    uint next = 0;                // where to go down
    uint face_axis = NO_AXIS;     // the face through which the ray came, and its band
    float face_low = root.t_near; // at the start no plane is behind ..
    float face_high = -INFINITY;  // .. unless its band is, and none undecided
    while (true) {
        // Go down to the leaf behind the face.
        int4 node = LOAD_NODE(geometry, next);
        while ((uint)node.x != KD_LEAF) {
            COUNT(geometry, STEPS, 1);
            const KdSplit split = kd_split(ray, node);
            if (split.t_high < face_low) {
                next = split.second;
            } else if ((uint)node.x == face_axis || split.t_low > face_high) {
                next = split.first;
            } else {
                COUNT(geometry, RESTARTS, 1);
                return push_down(GEOMETRY, ray, root, any_hit, hit);
            }
            node = LOAD_NODE(geometry, next);
        }

        if (test_leaf(GEOMETRY, ray, node, any_hit, hit)) return true;

        // Find the exit face: the nearest of three.
        const float4 x = LOAD_BOUNDS(geometry, 3u * (uint)node.w);
        const float4 y = LOAD_BOUNDS(geometry, 3u * (uint)node.w + 1u);
        const float4 z = LOAD_BOUNDS(geometry, 3u * (uint)node.w + 2u);
        const float3 t = leave_slabs(ray, x, y, z, -PLANE_ERROR);
        const uint axis = t.y < t.x ? (t.z < t.y ? 2u : 1u) : (t.z < t.x ? 2u : 0u);
        const float exit_low = widen_down(component(t, axis));
        const float exit_high = widen_up(component(leave_slabs(ray, x, y, z, PLANE_ERROR), axis));

        // Start over unless the chain is single (1 and 2 above). A ray in a face leaves it at -infinity at the
        // earliest, and a NaN fails a comparison.
        const bool single = (axis == 0u || widen_down(t.x) > exit_high) &&
                            (axis == 1u || widen_down(t.y) > exit_high) &&
                            (axis == 2u || widen_down(t.z) > exit_high) && (axis == face_axis || exit_low > face_high);
        if (!single) {
            COUNT(geometry, RESTARTS, 1);
            return push_down(GEOMETRY, ray, root, any_hit, hit);
        }

        // Follow the rope, unless the neighbour lies behind the hit, behind the ray's end, or outside the scene.
        next = axis == 0u   ? rope_ahead(x, ray->direction.x)
               : axis == 1u ? rope_ahead(y, ray->direction.y)
                            : rope_ahead(z, ray->direction.z);
        if (hit->t < exit_low || exit_low > root.t_far || next == NO_ROPE) return hit->primitive != NO_PRIMITIVE;
        face_axis = axis;
        face_low = exit_low;
        face_high = exit_high;
    }
}
