// Direct light: where a light stands as seen from a point, and what a surface makes of it.
// Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.

typedef struct {
    float3 to_light; // the light is at to_light * t_far
    float3 direction; // to_light, unit
    float3 radiance; // what arrives if nothing is in the way
    float t_far;
} LightSample;

LightSample sample_light(__global const Light* lights, uint index, float3 position) {
    const Light light = lights[index];
    LightSample sample;
    sample.radiance = light.intensity.xyz;
    if (light.kind == LIGHT_DIRECTIONAL) {
        sample.to_light = -light.direction.xyz;
        sample.direction = sample.to_light;
        sample.t_far = INFINITY;
        return sample;
    }
    sample.to_light = light.position.xyz - position;
    sample.direction = normalize3(sample.to_light, (float3)(0.0f));
    sample.t_far = 1.0f;
    if (light.quadratic > 0.0f) sample.radiance *= 1.0f / (dot3(sample.to_light, sample.to_light) * light.quadratic);
    if (light.kind == LIGHT_SPOT) {
        const float cosine = -dot3(sample.direction, light.direction.xyz);
        const float edge = clamp01((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer));
        sample.radiance *= edge * edge * (3.0f - 2.0f * edge);
    }
    // A point on the light itself has neither direction nor a finite radiance.
    if (!is_finite3(sample.radiance)) sample.radiance = (float3)(0.0f);
    return sample;
}

// Light that the surface sends towards -view_direction (unit), for a light that is not in shadow. Zero when the light is below
// the surface, judged by both normals: a smooth normal must not let light through the back of its triangle.
float3 blinn_phong(const Surface* surface, const Material* material, float3 diffuse, float3 view_direction,
                   const LightSample* sample) {
    const float cosine = dot3(surface->normal, sample->direction);
    if (!(cosine > 0.0f && dot3(surface->geometric_normal, sample->direction) > 0.0f)) return (float3)(0.0f);
    float3 reflected = diffuse * cosine;
    if (max_component(material->specular_shininess.xyz) > 0.0f) {
        const float3 halfway = normalize3(sample->direction - view_direction, surface->normal);
        const float highlight = power_fixed(clamp01(dot3(surface->normal, halfway)), material->specular_shininess.w);
        reflected = fma3(material->specular_shininess.xyz, highlight, reflected);
    }
    return reflected * sample->radiance;
}
