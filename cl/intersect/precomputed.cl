// Ray-triangle intersection in the triangle's own coordinates, by a transform that the host computed.
// Baldwin and Weber, "Fast Ray-Triangle Intersections by Coordinate Transformation", JCGT 5(3), 2016.
//
// An affine map takes the triangle to (0,0) (1,0) (0,1) in the plane w = 0: the ray's w gives t, the other two
// coordinates of the hit are u and v. One axis of the map is free; laid along the world axis where the triangle's
// normal is largest it leaves nine numbers that are not 0 or 1. The paper folds the translation into them; here vertex
// 0 is subtracted first, for as many numbers, so that a small triangle far from the scene's origin keeps its digits.
//
//   transforms[3 i + 0]  vertex 0 in x, y, z; w: the bits of the axis k
//   transforms[3 i + 1]  n_x n_y: normal divided by its component k, along the axes k + 1 and k + 2; u_x u_y: gradient
//                        of u there
//   transforms[3 i + 2]  v_x v_y: gradient of v; z, w unused
//
// Less than a third of Moller-Trumbore's operations (14 to 49), for as much memory again as the vertices. Not
// watertight: the gradients of two neighbours are rounded independently. A gradient is infinite, and the triangle lost,
// when its height is below 1e-38.

// The components of v from axis k on, in turn.
float3 rotate_to_x(float3 v, uint axis) { return axis == 0u ? v : axis == 1u ? v.yzx : v.zxy; }

bool intersect_precomputed(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const float4 corner_axis = LOAD_TRANSFORM(geometry, 3u * slot);
    const float4 normal_u = LOAD_TRANSFORM(geometry, 3u * slot + 1u);
    const float4 gradient_v = LOAD_TRANSFORM(geometry, 3u * slot + 2u);
    const uint axis = as_uint(corner_axis.w);
    const float3 from = rotate_to_x(-from_origin(ray, corner_axis.xyz), axis);
    const float3 direction = rotate_to_x(ray->direction, axis);

    const float height = fma(normal_u.x, from.y, fma(normal_u.y, from.z, from.x));
    const float descent = fma(normal_u.x, direction.y, fma(normal_u.y, direction.z, direction.x));
    *t = -height / descent; // a parallel ray gives infinity or NaN: rejected below
    const float x = fma(*t, direction.y, from.y);
    const float y = fma(*t, direction.z, from.z);
    *u = fma(normal_u.z, x, normal_u.w * y);
    *v = fma(gradient_v.x, x, gradient_v.y * y);
    return *u >= 0.0f && *v >= 0.0f && *u + *v <= 1.0f && is_finite(*t);
}
