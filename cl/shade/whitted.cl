// Secondary rays: mirror reflection, and refraction with Fresnel's equations and total internal reflection.
// Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980; thesis, section 2.1.2.

// The direction of unit `direction` mirrored at the surface; at the geometric normal where a smooth normal would send it
// through the triangle.
float3 reflect_direction(const Surface* surface, float3 direction) {
    const float3 reflected = fma3(surface->normal, -2.0f * dot3(surface->normal, direction), direction);
    if (dot3(reflected, surface->geometric_normal) > 0.0f) return reflected;
    return fma3(surface->geometric_normal, -2.0f * dot3(surface->geometric_normal, direction), direction);
}

typedef struct {
    float reflectance;  // 1: total reflection, nothing is refracted
    float3 direction;   // of the refracted ray
} Refraction;

// Snell's law and the unpolarised Fresnel reflectance for a ray along unit `direction`.
// `eta` is the index of refraction on the ray's side divided by that beyond the surface.
Refraction refract_direction(const Surface* surface, float3 direction, float eta) {
    Refraction refraction = {1.0f, direction};
    const float cos_in = clamp01(-dot3(surface->normal, direction));
    const float sin2_out = eta * eta * fma(-cos_in, cos_in, 1.0f);
    if (!(sin2_out < 1.0f)) return refraction;
    if (eta == 1.0f) { // nothing changes: the ray goes straight on, whatever the interpolated normal says
        refraction.reflectance = 0.0f;
        return refraction;
    }
    const float cos_out = sqrt(1.0f - sin2_out);
    const float s = fma(eta, cos_in, -cos_out) / fma(eta, cos_in, cos_out);
    const float p = fma(eta, cos_out, -cos_in) / fma(eta, cos_out, cos_in);
    const float reflectance = 0.5f * fma(s, s, p * p);
    refraction.reflectance = reflectance < 1.0f ? reflectance : 1.0f; // grazing: 0 / 0 would be NaN
    refraction.direction = fma3(direction, eta, surface->normal * fma(eta, cos_in, -cos_out));
    // A smooth normal may send it back to where it came from.
    if (!(dot3(refraction.direction, surface->geometric_normal) < 0.0f)) refraction.direction = direction;
    return refraction;
}

// A ray that waits to be traced, with what it will add to the pixel per unit of radiance.
typedef struct {
    Ray ray;
    float3 weight;
    uint depth; // 1 for a camera ray
    uint kind;  // COUNT_CAMERA_CAST, COUNT_REFLECTED_CAST or COUNT_REFRACTED_CAST
} PendingRay;

// Puts the rays that leave the surface on the stack of pending ones; returns its new size (at most two more).
// A ray whose weight is below kill_weight in every channel could not change the pixel and is left out.
uint push_secondary_rays(const Surface* surface, const Material* material, const PendingRay* pending, float3 direction,
                         float kill_weight, PendingRay* stack, uint stacked) {
    float3 reflected_weight = pending->weight * material->mirror.xyz;
    if (material->transparent != 0u) {
        const float ior = material->transmission_ior.w;
        const Refraction refraction = refract_direction(surface, direction, surface->front ? 1.0f / ior : ior);
        reflected_weight = pending->weight * refraction.reflectance;
        const float3 weight = pending->weight * material->transmission_ior.xyz * (1.0f - refraction.reflectance);
        if (max_component(weight) > kill_weight) {
            stack[stacked].ray = leave_surface(&surface->point, refraction.direction, INFINITY);
            stack[stacked].weight = weight;
            stack[stacked].depth = pending->depth + 1u;
            stack[stacked].kind = COUNT_REFRACTED_CAST;
            stacked++;
        }
    }
    if (max_component(reflected_weight) > kill_weight) {
        stack[stacked].ray = leave_surface(&surface->point, reflect_direction(surface, direction), INFINITY);
        stack[stacked].weight = reflected_weight;
        stack[stacked].depth = pending->depth + 1u;
        stack[stacked].kind = COUNT_REFLECTED_CAST;
        stacked++;
    }
    return stacked;
}
