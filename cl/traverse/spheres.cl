// Spheres around clusters of triangles, one after the other.
// Thesis, section 2.2.2 ("the sphere is the cheapest test"); Whitted, "An Improved Illumination Model for Shaded
// Display", Communications of the ACM 23(6), 1980, section 3.
//
// As boxes.cl, with half the memory for the bounds. A sphere around flat or long things is mostly empty: more triangles
// are tested than with boxes, and a test of three slabs has become as cheap as the sphere's with its square root.
//
// nodes as in boxes.cl; bounds[i] is the sphere of cluster i, {centre, radius}.

// What the radius and the times grow by, in units of D of cl/shared/ray.cl. All lengths here are Euclidean: a vector
// whose components are at most D is not longer than 1.74 D, and HIT_ERROR becomes 56. To first order:
// - to_centre is off by 2, along by 5 + 3 + 5 of |to_centre| / |direction| (the product, the square, a division of up
//   to 2.5 ulp), so beside, which is fma'd once more, by 15 |to_centre| = 26 D. The sum with HIT_ERROR, 82, leaves room
//   for the roundings of the radius and of the squares: 3 + 3 EPSILON each, covered by widen_up and widen_down.
// - half_chord is off by 16 radius, so by 28 D, along by 13 |to_centre| / |direction|, so by 23 D, and the sums round
//   by 10 D: 61 D in all. The radicand itself is too large: (R + 96)^2 - (b + 26)^2 > (R + 56)^2 - b^2 for b <= R + 56.
// SPHERE_SLACK is 96 EPSILON.

// Whether the ray meets the sphere within its limits before t_hit, a little more often rather than less. Every
// comparison is false for NaN, which arises from overflow: the sphere then counts as met, and so it does where a
// direction of up to 2^61 makes `along` overflow. The distance from the centre comes from the vector
// `beside`, not from |to_centre|^2 - along^2, which would cancel for distant spheres (Haines et al., "Precision
// Improvements for Ray/Sphere Intersection", Ray Tracing Gems 2019).
bool may_meet_sphere(const Ray* ray, float slack, float4 sphere, float t_hit) {
    const float3 to_centre = from_origin(ray, sphere.xyz);
    const float square = dot3(ray->direction, ray->direction);
    const float along = dot3(ray->direction, to_centre) / square;
    if (!is_finite(along)) return true;
    const float3 beside = fma3(ray->direction, -along, to_centre);
    const float radius = sphere.w + slack;
    const float beside2 = widen_down(dot3(beside, beside));
    const float radius2 = widen_up(radius * radius);
    if (beside2 > radius2) return false;
    const float half_chord = sqrt((radius2 - beside2) / square);
    const float t_near = (along - half_chord) - slack;
    const float t_far = (along + half_chord) + slack;
    return !(t_near > ray->t_far || t_far < ray->t_near || t_hit < t_near);
}

bool traverse_spheres(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const float slack = SPHERE_SLACK * padding_distance(ray, geometry->low, geometry->high, geometry->near_reach);
    const uint count = (uint)LOAD_NODE(geometry, 0).z;
    for (uint cluster = 0; cluster < count; cluster++) {
        COUNT(geometry, STEPS, 1);
        if (!may_meet_sphere(ray, slack, LOAD_BOUNDS(geometry, cluster), hit->t)) continue;
        if (test_leaf(GEOMETRY, ray, LOAD_NODE(geometry, 1u + cluster), any_hit, hit)) return true;
    }
    return hit->primitive != NO_PRIMITIVE;
}
