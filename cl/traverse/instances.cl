// Two levels of binary hierarchies of boxes: one of the instances, in tracing space, and one for each object, in its
// own coordinates, to which rays are taken when they enter the box of an instance.
// Rubin and Whitted, "A 3-Dimensional Representation for Fast Rendering of Complex Scenes", SIGGRAPH 1980.
//
// An object that stands in the scene a thousand times takes the memory of one. Hits are those of the flattened scene,
// bit for bit: rays in object coordinates meet boxes alone, with a padding for their rounding (make_instance_slabs in
// slab.cl), and triangles are placed in the scene before they are tested (cl/shared/instances.cl). t is the same in
// both spaces.
//
// Bad at: objects whose boxes overlap, all of which a ray enters; a scene of one object, which gains nothing and pays
// for transforms.
//
// nodes: as bvh2.cl has them, but boxes without padding, the instances' hierarchy first. bounds: instances, as
// src/pack/instances.rs says.
#ifdef INSTANCES

// Not so the leaf that is no child, whose box rays from very far away meet with all others.
bool is_instance(uint link) { return (link & ~BVH_FIRST_MASK) == BVH_LEAF && link != BVH_LEAF; }

bool traverse_instances(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const Slabs outside = make_slabs(ray, geometry->low, geometry->high, geometry->near_reach);
    PairSlabs pair = make_pair_slabs(&outside);

    uint stack[STACK_SIZE];
    stack[0] = BVH_END;
    uint stacked = 0; // apart from the end
    uint link = 0;
    while (true) {
        link = descend_to_leaf(GEOMETRY, &pair, ray->t_near, hit->t, false, any_hit, stack, &stacked, link);
        if (link == BVH_END) return hit->primitive != NO_PRIMITIVE;

        if (is_instance(link)) {
            stack[++stacked] = BVH_LEAVE;
            COUNT_DEEPEST(geometry, stacked);
            COUNT(geometry, NODE_BYTES, INSTANCE_RECORDS * sizeof(float4));
            const uint instance = (link & BVH_FIRST_MASK) - 1u;
            const uint first = INSTANCE_RECORDS * instance;
            const float4 reach = BOUNDS_RECORD(geometry, first + INSTANCE_REACH);
            const Slabs inside = make_instance_slabs(ray, geometry->low, geometry->high,
                                                     BOUNDS_RECORD(geometry, first + INSTANCE_TO_OBJECT),
                                                     BOUNDS_RECORD(geometry, first + INSTANCE_TO_OBJECT + 1u),
                                                     BOUNDS_RECORD(geometry, first + INSTANCE_TO_OBJECT + 2u),
                                                     reach.xyz, BOUNDS_RECORD(geometry, first + INSTANCE_BLUR).xyz);
            pair = make_pair_slabs(&inside);
            geometry->placed->to_primitive = 0u - instance_number(GEOMETRY, instance, INSTANCE_NORMALS + 2u);
            link = as_uint(reach.w);
            continue;
        }
        if (link == BVH_LEAVE) {
            pair = make_pair_slabs(&outside);
        } else {
            if (test_leaf(GEOMETRY, ray, leaf_of_link(link), any_hit, hit)) return true;
        }
        link = stack[stacked--];
    }
}
#endif
