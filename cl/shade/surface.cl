// What a hit is: position, normals, texture coordinates, material.

// A point on a triangle, as rays start from it.
typedef struct {
    float3 position;     // computed from the vertices' weights, not from t; rounded
    float3 position_low; // what that leaves out; see start_on_triangle
    float3 weights;      // as those of Ray
    float error;         // how far from it, on each axis, the triangle test may meet what should only touch it
    uint primitive;
} SurfacePoint;

typedef struct {
    SurfacePoint point;
    float3 geometric_normal; // unit, towards the side that the ray came from
    float3 normal;           // unit, interpolated, on the same side as geometric_normal
    float3 lift;             // from the triangle to where shadow rays start, see smooth_lift()
    float largest_coordinate; // of the triangle's vertices, without sign
    float texture_u, texture_v;
    uint material;
    bool front; // the ray came from the side on which the vertices run counter-clockwise
} Surface;

// The weights of a hit as a Ray has them: the two smaller ones, which are floats as near as can be.
float3 start_weights(const SurfaceHit* hit) {
    if (is_nearest_vertex0(hit->u, hit->v)) return (float3)(-1.0f, hit->u, hit->v);
    return hit->u >= hit->v ? (float3)(hit->weight0, -1.0f, hit->v) : (float3)(hit->weight0, hit->u, -1.0f);
}

// Where the hit lies: all that a ray needs to leave from there.
ONE_COPY SurfacePoint surface_point(GEOMETRY_PARAMETERS, const SurfaceHit* hit) {
    const float3 p0 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 0);
    const float3 p1 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 1);
    const float3 p2 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 2);
    SurfacePoint point;
    point.weights = start_weights(hit);
    const TrianglePoint at = point_of_weights(p0, p1, p2, point.weights);
    start_on_triangle(&at, &point.position, &point.position_low);
    point.error = LEAVING_ERROR(p0, p1, p2);
    point.primitive = hit->primitive;
    return point;
}

// Adds to a surface's point what else a ray of that direction sees of the triangle: `outward` is its normal, as
// triangle_normal() has it.
void complete_surface(GEOMETRY_PARAMETERS, __global const Shading* shading, float3 direction, const SurfaceHit* hit,
                      float3 outward, Surface* surface) {
    const Shading at = LOAD_SHADING(shading, hit->primitive);
    const float w = (1.0f - hit->u) - hit->v;
    surface->material = HAS(FEATURE_SEVERAL_MATERIALS) ? at.material : 0u;
    // Rounding to tracing space may have flattened the triangle: it then looks at the ray.
    if (outward.x == 0.0f && outward.y == 0.0f && outward.z == 0.0f)
        outward = normalize3(-direction, (float3)(0.0f, 0.0f, 1.0f));
    surface->front = dot3(outward, direction) < 0.0f;
    surface->geometric_normal = surface->front ? outward : -outward;
    surface->normal = surface->geometric_normal;
    if (HAS(FEATURE_SMOOTH_NORMALS))
        surface->normal = interpolated_normal(at.normal0_u0.xyz, at.normal1_u1.xyz, at.normal2_u2.xyz, w, hit->u,
                                              hit->v, surface->geometric_normal);
    surface->lift = (float3)(0.0f);
    if (SMOOTH_TERMINATOR && HAS(FEATURE_SMOOTH_NORMALS)) {
        const float3 p0 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 0);
        const float3 p1 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 1);
        const float3 p2 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 2);
        surface->lift = smooth_lift(p1 - p0, p2 - p0, at.normal0_u0.xyz, at.normal1_u1.xyz, at.normal2_u2.xyz, w,
                                    hit->u, hit->v, surface->geometric_normal);
    }
    surface->texture_u = fma(at.normal0_u0.w, w, fma(at.normal1_u1.w, hit->u, at.normal2_u2.w * hit->v));
    surface->texture_v = fma(at.v0, w, fma(at.v1, hit->u, at.v2 * hit->v));
}

Surface surface_at(GEOMETRY_PARAMETERS, __global const Shading* shading, const Ray* ray, const SurfaceHit* hit) {
    const float3 p0 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 0);
    const float3 p1 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 1);
    const float3 p2 = LOAD_SURFACE_VERTEX(geometry, hit->primitive, 2);
    Surface surface;
    surface.point = surface_point(GEOMETRY, hit);
    surface.largest_coordinate =
        max_or(max_or(max_component(abs3(p0)), max_component(abs3(p1))), max_component(abs3(p2)));
    complete_surface(GEOMETRY, shading, ray->direction, hit, triangle_normal(p0, p1, p2), &surface);
    return surface;
}

// Moves the point to where shadow rays start, which is above the triangle. Through a pointer: of a returned struct
// Oclgrind 21.10 makes what it cannot run.
void lift_point(SurfacePoint* point, float3 lift) {
    if (!HAS(FEATURE_SMOOTH_NORMALS) || (lift.x == 0.0f && lift.y == 0.0f && lift.z == 0.0f)) return;
    point->position += lift;
    point->position_low = (float3)(0.0f);
    point->weights = (float3)(0.0f);
}

// A ray that leaves a surface, from an exact point of the triangle, which is itself skipped by its number. With exact
// hits that is all: what contains that point, too, is met at t = 0 and not hit. Rounded tests meet such neighbours,
// which share an edge or vertex, at a distance of at most point.error on an axis along which the ray advances at least
// 1 per unit of t: twice that covers it where the surface is left at more than a grazing angle.
ONE_COPY Ray leave_surface(const SurfacePoint* point, float3 direction, float t_far) {
    Ray ray = make_ray(point->position, direction, 0.0f, t_far, point->primitive);
    ray.origin_low = point->position_low;
    ray.start_weights = point->weights;
    ray.t_near = max_or(ray.t_near, 2.0f * point->error); // stays infinite for a ray without direction
    return ray;
}
