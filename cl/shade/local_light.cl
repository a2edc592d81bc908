// The light that a surface sends back from the lamps, and gives off itself; in pieces, because the wavefront kernels
// take them one at a time (cl/kernels/wavefront.cl) and the mega-kernel all at once (cl/kernels/render.cl).

typedef struct {
    float3 diffuse;  // colour for diffuse reflection, textured
    float3 radiance; // towards the viewer, so far
} LocalLight;

bool is_textured(const Material* material) {
    return (HAS(FEATURE_IMAGE_TEXTURES) || HAS(FEATURE_PROCEDURAL_TEXTURES)) && material->texture != NO_TEXTURE;
}

// The colour that the material's texture, which it must have, gives the surface to a ray along unit `direction`.
float3 texture_colour(SCENE_PARAMETERS, const Surface* surface, const Material* material, const PendingRay* pending,
                      float3 direction) {
    const Geometry* geometry = &scene->geometry;
    Footprint footprint = {(float2)(0.0f), (float2)(0.0f)};
    if (HAS_CONES && scene->textures[material->texture].kind == TEXTURE_IMAGE) {
        const RayCone cone = cone_at(pending->cone, pending->ray.origin, surface->point.position);
        footprint = footprint_at(GEOMETRY, scene->shading, surface, direction, cone.width);
    }
    return surface_colour(scene->textures, scene->texels, scene->srgb_to_linear, material->texture, surface->texture_u,
                          surface->texture_v, &footprint, solid_position(surface));
}

// What arrives without any lamp at a surface with unit `normal` that is seen along unit `direction`, and nothing is in
// the way of.
//
// Of a sky that is `top` in all directions above and `bottom` in all below, a surface gets the mean, weighted by the
// cosine. The part of `top` in it is (1 + cos) / 2, cos being that between its normal and up: a line, so that a sky of
// two halves is a sky of first-order spherical harmonics (Ramamoorthi and Hanrahan, "An Efficient Representation for
// Irradiance Environment Maps", SIGGRAPH 2001). A lamp where the ray starts sees what the ray sees: it needs no shadow
// ray.
float3 sky_light(const Scene* scene, float3 normal, float3 direction) {
    const float3 bottom = scene->params->sky_bottom.xyz;
    const float3 sky = fma3(scene->params->sky_top.xyz - bottom, height_of(scene, normal), bottom);
    return fma3(scene->params->sky_viewer.xyz, clamp01(-dot3(normal, direction)), sky);
}

// The light without any lamp: ambient light, that of the sky, and what the surface gives off, to a ray along unit
// `direction`. `colour` is that of the material's texture, and means nothing where it has none.
LocalLight begin_local_light(const Scene* scene, const Surface* surface, const Material* material, float3 direction,
                             float3 colour) {
    LocalLight light;
    light.diffuse = material->diffuse.xyz;
    light.radiance = material->ambient.xyz;
    if (is_textured(material)) {
        light.diffuse *= colour;
        light.radiance *= colour;
    }
    if (HAS(FEATURE_SKY)) light.radiance += light.diffuse * sky_light(scene, surface->normal, direction);
    light.radiance += material->emission.xyz;
    return light;
}

// The same of a surface, textured, to a ray along unit `direction`.
LocalLight light_without_lamps(SCENE_PARAMETERS, const Surface* surface, const Material* material,
                               const PendingRay* pending, float3 direction) {
    float3 colour = (float3)(1.0f);
    if (is_textured(material)) colour = texture_colour(SCENE, surface, material, pending, direction);
    return begin_local_light(scene, surface, material, direction, colour);
}

// What a light adds where nothing is in its way. False when that is nothing, so that no shadow ray is needed; else the
// lamp is at sample->to_light * t_far as seen from where the shadow ray starts. `halfway`: see blinn_phong().
bool reflect_sample(const Surface* surface, const Material* material, float3 diffuse, float3 view_direction,
                    const float3* halfway, LightSample* sample, float3* reflected) {
    *reflected = blinn_phong(surface, material, diffuse, view_direction, sample, halfway);
    if (HAS(FEATURE_SMOOTH_NORMALS) && sample->t_far == 1.0f) sample->to_light -= surface->lift;
    return max_component(*reflected) > 0.0f;
}

// The same of lamp number `index`.
bool light_term(const Scene* scene, const Surface* surface, const Material* material, float3 diffuse,
                float3 view_direction, uint index, LightSample* sample, float3* reflected) {
    *sample = sample_light(scene->lights, index, surface->point.position);
    return reflect_sample(surface, material, diffuse, view_direction, 0, sample, reflected);
}

// Tints the light that a shadow ray has met a surface on its way to. False where the surface is opaque.
bool pass_surface(SCENE_PARAMETERS, uint primitive, float3* tint) {
    const Geometry* geometry = &scene->geometry;
    __global const Material* material = &scene->materials[MATERIAL_OF(scene, primitive)];
    if (material->transparent == 0u) return false;
    *tint *= material->transmission_ior.xyz;
    return true;
}

// The direction in which a shadow ray goes on to the same light from `point`, having begun at `from`.
float3 still_to_light(const SurfacePoint* from, const LightSample* sample, float3 point) {
    return sample->t_far == 1.0f ? from->position + sample->to_light - point : sample->to_light;
}

// What remains of the light after it has passed the transparent surfaces on its way; zero behind an opaque one. Of the
// sample only to_light and t_far matter.
float3 light_visibility(SCENE_PARAMETERS, const SurfacePoint* from, const LightSample* sample, uint* counts) {
    const Geometry* geometry = &scene->geometry;
    Ray ray = leave_surface(from, sample->to_light, sample->t_far);
    Hit hit;
    counts[COUNT_SHADOW_CAST]++;
    if (!has_transparent(scene)) {
        const bool blocked = trace_ray(GEOMETRY, &ray, true, &hit);
        counts[COUNT_SHADOW_HIT] += blocked ? 1u : 0u;
        return (float3)(blocked ? 0.0f : 1.0f);
    }
    float3 tint = (float3)(1.0f);
    for (uint layer = 0; layer < MAX_SHADOW_LAYERS; layer++) {
        if (!trace_ray(GEOMETRY, &ray, false, &hit)) return tint;
        if (!pass_surface(SCENE, hit.primitive, &tint)) break;
        SurfaceHit passed;
        SURFACE_HIT(GEOMETRY, &ray, &hit, &passed);
        const SurfacePoint point = surface_point(GEOMETRY, &passed);
        ray = leave_surface(&point, still_to_light(from, sample, point.position), sample->t_far);
    }
    counts[COUNT_SHADOW_HIT]++;
    return (float3)(0.0f);
}
