// Direct light: where a light stands as seen from a point, and what a surface makes of it.
// Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.

typedef struct {
    float3 to_light; // the light is at to_light * t_far
    float3 direction; // to_light, unit
    float3 radiance; // what arrives if nothing is in the way
    float t_far;
} LightSample;

// Radiance limited to what the sum of a pixel's samples can hold, see MAX_RADIANCE. NaN stays.
float3 limit_radiance(float3 radiance) {
    return (float3)(min_or(MAX_RADIANCE, radiance.x), min_or(MAX_RADIANCE, radiance.y),
                    min_or(MAX_RADIANCE, radiance.z));
}

// Where a lamp is as seen from a point: what of a LightSample takes longest.
typedef struct {
    float3 direction;        // unit; zero for a lamp in that very point, which is seen in no direction
    float scale, inv_length; // their product is the reciprocal of the distance
} LampDirection;

// These through a pointer: of structs returned within returned structs Oclgrind 21.10 makes what it cannot run.
void find_lamp(float3 to_light, LampDirection* towards) {
    towards->direction = (float3)(0.0f);
    towards->scale = 1.0f;
    towards->inv_length = 0.0f;
    if (!scale_to_unit(&to_light, &towards->scale)) return;
    towards->inv_length = 1.0f / sqrt(dot3(to_light, to_light));
    towards->direction = to_light * towards->inv_length;
}

bool is_directional(__global const Light* light) {
    return HAS(FEATURE_DIRECTIONAL_LIGHTS) && (!HAS(FEATURE_PLACED_LIGHTS) || light->kind == LIGHT_DIRECTIONAL);
}

// The light of a lamp of which that is known: any that is not directional. One that is seen in no direction gives none.
void sample_lamp(__global const Light* at, float3 to_light, const LampDirection* towards, LightSample* sample) {
    const Light light = *at;
    sample->to_light = to_light;
    sample->direction = towards->direction;
    sample->t_far = 1.0f;
    sample->radiance = light.intensity.xyz;
    if (HAS(FEATURE_FALLOFF) && light.falloff_scale > 0.0f && towards->inv_length > 0.0f) {
        // The reciprocal of the distance in world units. Its square may leave float's range where the product with the
        // intensity does not.
        const float inv_distance = min_or(light.falloff_scale * towards->scale * towards->inv_length, FLT_MAX);
        sample->radiance = limit_radiance(sample->radiance * inv_distance * inv_distance);
    }
    if (HAS(FEATURE_SPOTS) && light.kind == LIGHT_SPOT) {
        const float cosine = -dot3(sample->direction, light.direction.xyz);
        const float edge = clamp01((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer));
        sample->radiance *= edge * edge * (3.0f - 2.0f * edge);
    }
}

// The light as seen from `position`.
LightSample sample_light(__global const Light* lights, uint index, float3 position) {
    __global const Light* light = &lights[index];
    LightSample sample;
    if (is_directional(light)) {
        sample.to_light = -light->direction.xyz;
        sample.direction = sample.to_light;
        sample.radiance = light->intensity.xyz;
        sample.t_far = INFINITY;
        return sample;
    }
    const float3 to_light = light->position.xyz - position;
    LampDirection towards;
    find_lamp(to_light, &towards);
    sample_lamp(light, to_light, &towards, &sample);
    return sample;
}

// The tone of threshold ("cartoon") shading for a cosine: 0 below the threshold, above it one of `steps` equal steps up
// to 1 (thesis, section 3.3.2; Lake et al., "Stylized Rendering Techniques for Scalable Real-Time 3D Animation", NPAR
// 2000).
float toon_tone(float cosine, uint steps, float threshold) {
    const float above = (cosine - threshold) / (1.0f - threshold);
    if (!(above >= 0.0f)) return 0.0f;
    const float count = (float)steps;
    const float step = floor(above * count) + 1.0f;
    return step < count ? step / count : 1.0f;
}

// Light that the surface sends towards -view_direction (unit), for a light that is not in shadow. Zero when the light
// is below the surface, judged by both normals: a smooth normal must not let light through the back of its triangle.
// Where shadow rays start above the triangle (see smooth_lift()) they find out by themselves what is in the way, and
// the smooth normal alone judges. `halfway`: the unit direction between those to light and viewer, where it is known,
// else 0.
float3 blinn_phong(const Surface* surface, const Material* material, float3 diffuse, float3 view_direction,
                   const LightSample* sample, const float3* halfway) {
    const float cosine = dot3(surface->normal, sample->direction);
    const bool is_lifted = HAS(FEATURE_SMOOTH_NORMALS) && any(surface->lift != (float3)(0.0f));
    if (!(cosine > 0.0f && (is_lifted || dot3(surface->geometric_normal, sample->direction) > 0.0f)))
        return (float3)(0.0f);
    const bool toon = HAS(FEATURE_TOON) && material->toon_steps > 0u;
    float3 reflected = diffuse * (toon ? toon_tone(cosine, material->toon_steps, material->toon_threshold) : cosine);
    if (HAS(FEATURE_HIGHLIGHTS) && max_component(material->specular_shininess.xyz) > 0.0f) {
        const float3 middle = halfway != 0 ? *halfway : normalize3(sample->direction - view_direction, surface->normal);
        float highlight = power_fixed(clamp01(dot3(surface->normal, middle)), material->specular_shininess.w);
        // A cartoon's highlight is a spot with a sharp rim, where the smooth one would have half of its strength.
        if (toon) highlight = highlight >= TOON_HIGHLIGHT ? 1.0f : 0.0f;
        reflected = fma3(material->specular_shininess.xyz, highlight, reflected);
    }
    return limit_radiance(reflected * sample->radiance);
}
