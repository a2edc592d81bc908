// Secondary rays: mirror reflection, and refraction with Fresnel's equations and total internal reflection.
// Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980; thesis, section 2.1.2.

// `direction`, or where a smooth normal sends it to the wrong side of its triangle, that mirrored at the triangle's
// plane. A ray on the wrong side would show the inside of the object: black spots along the outlines of coarse meshes.
// Mirrored it changes smoothly where the side changes, unlike the reflection at the geometric normal, which leaves a
// seam. `normal`: the geometric one, towards the right side.
float3 keep_side(float3 direction, float3 normal) {
    const float height = dot3(direction, normal);
    return height < 0.0f ? fma3(normal, -2.0f * height, direction) : direction;
}

// The direction of unit `direction` mirrored at the surface.
float3 reflect_direction(const Surface* surface, float3 direction) {
    const float3 reflected = fma3(surface->normal, -2.0f * dot3(surface->normal, direction), direction);
    return keep_side(reflected, surface->geometric_normal);
}

typedef struct {
    float reflectance;  // 1: total reflection, nothing is refracted
    float3 direction;   // of the refracted ray
} Refraction;

// Snell's law and the unpolarised Fresnel reflectance for a ray along unit `direction`.
// `eta` is the index of refraction on the ray's side divided by that beyond the surface.
//
// There is no division by zero: short of total reflection cos_out is at least 2^-12, because sin2_out is at most 1 -
// 2^-24. Of an eta near the ends of float's range products may be NaN; that counts as total reflection, which it is but
// for 2^-60.
Refraction refract_direction(const Surface* surface, float3 direction, float eta) {
    Refraction refraction = {1.0f, direction};
    if (eta == 1.0f) { // nothing changes: the ray goes straight on, whatever the interpolated normal says
        refraction.reflectance = 0.0f;
        return refraction;
    }
    const float cos_in = clamp01(-dot3(surface->normal, direction));
    // The part of the direction along the surface. Its length, not 1 - cos^2, gives the sine, so that the refracted
    // direction has length 1 also where eta is large and multiplies all roundings.
    const float3 along = fma3(surface->normal, cos_in, direction);
    const float sin2_out = eta * eta * dot3(along, along);
    if (!(sin2_out < 1.0f)) return refraction;
    const float cos_out = sqrt(1.0f - sin2_out);
    const float s = fma(eta, cos_in, -cos_out) / fma(eta, cos_in, cos_out);
    const float p = fma(eta, cos_out, -cos_in) / fma(eta, cos_out, cos_in);
    const float reflectance = 0.5f * fma(s, s, p * p);
    refraction.reflectance = reflectance < 1.0f ? reflectance : 1.0f; // grazing: 0 / 0 would be NaN
    refraction.direction = keep_side(fma3(surface->normal, -cos_out, along * eta), -surface->geometric_normal);
    return refraction;
}

// So many rays of a pixel may wait.
#ifndef MAX_PENDING
#define MAX_PENDING 8
#endif

// A ray that is traced next, with what it will add to the pixel per unit of radiance.
typedef struct {
    Ray ray;
    float3 weight;
    uint depth; // 1 for a camera ray; see next_depth()
    uint kind;  // COUNT_CAMERA_CAST, COUNT_REFLECTED_CAST or COUNT_REFRACTED_CAST
    RayCone cone;
} PendingRay;

// Records that hold numbers beside floats hold the bits of the floats: moving a float may change bits that mean a whole
// number.
int4 pack_bits(float3 v, uint w) { return (int4)(as_int3(v), as_int(w)); }

// Half of a PendingRay's bytes, for the time that it waits.
void store_pending(const PendingRay* pending, WaitingRay* to) {
    to->origin_t_near = (float4)(pending->ray.origin, pending->ray.t_near);
    to->origin_low_width = (float4)(pending->ray.origin_low, pending->cone.width);
    to->start_weights_spread = (float4)(pending->ray.start_weights, pending->cone.spread);
    to->direction_skip = pack_bits(pending->ray.direction, pending->ray.skip);
    to->weight_kind_depth = pack_bits(pending->weight, pack_way(pending->depth, pending->kind));
}

uint kind_of_waiting(const WaitingRay* ray) { return as_uint(ray->weight_kind_depth.w) & ((1u << RAY_KIND_BITS) - 1u); }

// What a waiting ray is beside the ray.
void load_history(const WaitingRay* from, PendingRay* pending) {
    pending->cone.width = from->origin_low_width.w;
    pending->cone.spread = from->start_weights_spread.w;
    pending->weight = as_float3(from->weight_kind_depth.xyz);
    pending->kind = kind_of_waiting(from);
    pending->depth = as_uint(from->weight_kind_depth.w) >> RAY_KIND_BITS;
}

// make_ray of a ray that it has made is that ray, bit for bit: its direction needs no scaling any more. The low part of
// the origin and the weights are not its business.
PendingRay load_pending(const WaitingRay* from) {
    PendingRay pending;
    pending.ray = make_ray(from->origin_t_near.xyz, as_float3(from->direction_skip.xyz), from->origin_t_near.w,
                           INFINITY, as_uint(from->direction_skip.w));
    pending.ray.origin_low = from->origin_low_width.xyz;
    pending.ray.start_weights = from->start_weights_spread.xyz;
    load_history(from, &pending);
    return pending;
}

// Lets a ray that leaves the surface along `direction` wait.
void push_ray(const Surface* surface, const PendingRay* from, float3 direction, float3 weight, uint kind,
              WaitingRay* to) {
    const RayCone cone = cone_at(from->cone, from->ray.origin, surface->point.position);
    const PendingRay pending = {leave_surface(&surface->point, direction, INFINITY), weight,
                                next_depth(from->depth, kind), kind, cone};
    store_pending(&pending, to);
}

// Puts the rays that leave the surface on the stack of pending ones; returns its new size (at most two more).
uint push_secondary_rays(const Surface* surface, const Material* material, const PendingRay* pending, float3 direction,
                         const Killing* killing, WaitingRay* stack, uint stacked) {
    if (!HAS(FEATURE_MIRRORS) && !HAS(FEATURE_TRANSPARENCY)) return stacked;
    float3 reflected_weight = pending->weight * material->mirror.xyz;
    if (HAS(FEATURE_TRANSPARENCY) && material->transparent != 0u) {
        const float ior = material->transmission_ior.w;
        const Refraction refraction = refract_direction(surface, direction, surface->front ? 1.0f / ior : ior);
        reflected_weight = pending->weight * refraction.reflectance;
        float3 weight = pending->weight * material->transmission_ior.xyz * (1.0f - refraction.reflectance);
        if (survives(killing, pending->depth, COUNT_REFRACTED_CAST, &weight))
            push_ray(surface, pending, refraction.direction, weight, COUNT_REFRACTED_CAST, &stack[stacked++]);
    }
    if (survives(killing, pending->depth, COUNT_REFLECTED_CAST, &reflected_weight))
        push_ray(surface, pending, reflect_direction(surface, direction), reflected_weight, COUNT_REFLECTED_CAST,
                 &stack[stacked++]);
    return stacked;
}
