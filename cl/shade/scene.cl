// The scene as shading sees it: all its arrays, how kernels hand them on, and what rays meet who miss everything.

#ifdef COUNT_WORK
#define CAMERA_GEOMETRY_VALUE MAKE_GEOMETRY_COUNTING(camera_work),
#define GEOMETRY_FOR(kind, scene) ((kind) == COUNT_CAMERA_CAST ? &(scene)->camera_geometry : &(scene)->geometry)
#else
#define CAMERA_GEOMETRY_VALUE
#define GEOMETRY_FOR(kind, scene) (&(scene)->geometry)
#endif

typedef struct {
    Geometry geometry;
#ifdef COUNT_WORK
    Geometry camera_geometry; // where the work on camera rays is counted, apart from all other
#endif
    __global const Shading* shading;
    __global const Material* materials;
    __global const Light* lights;
    __global const TextureInfo* textures;
    __global const uint* texels;
    __global const float* srgb_to_linear;
    __global const SceneParams* params;
} Scene;

// As GEOMETRY_PARAMETERS and its kin, for functions that take the whole scene.
#define SCENE_PARAMETERS const Scene* scene IMAGE_PARAMETERS
#define SCENE_AT(pointer) pointer IMAGE_VALUES
#define SCENE SCENE_AT(scene)

// SCENE_ARGUMENTS: what every shading kernel's arguments begin with. MAKE_SCENE: the Scene made of them.
#define SCENE_ARGUMENTS                                                                                        \
    GEOMETRY_ARGUMENTS, __global const Shading* restrict shading, __global const Material* restrict materials, \
        __global const Light* restrict lights, __global const TextureInfo* restrict textures,                  \
        __global const uint* restrict texels, __global const float* restrict srgb_to_linear
#define MAKE_SCENE \
    { MAKE_GEOMETRY, CAMERA_GEOMETRY_VALUE shading, materials, lights, textures, texels, srgb_to_linear, scene_params }

// The number of a triangle's material.
#define MATERIAL_OF(scene, primitive) (HAS(FEATURE_SEVERAL_MATERIALS) ? LOAD_MATERIAL((scene)->shading, primitive) : 0u)

uint light_count(const Scene* scene) { return HAS(FEATURE_SEVERAL_LIGHTS) ? scene->params->light_count : 1u; }

// Whether something is transparent, so that shadow rays must look for the tint.
bool has_transparent(const Scene* scene) { return HAS(FEATURE_TRANSPARENCY) && scene->params->has_transparent != 0u; }

// How far up unit `direction` leads: from 0, straight down, to 1, straight up. Without a sky y is up.
float height_of(const Scene* scene, float3 direction) {
    const float up = HAS(FEATURE_SKY) ? dot3(direction, scene->params->sky_up.xyz) : direction.y;
    return clamp01(fma(0.5f, up, 0.5f)); // a unit vector's rounding may lead beyond 1
}

// The light from where nothing is, along unit `direction`.
float3 background(const Scene* scene, float3 direction) {
    const float3 bottom = scene->params->background_bottom.xyz;
    return fma3(scene->params->background_top.xyz - bottom, height_of(scene, direction), bottom);
}
