// GENERATED from src/shared.rs by `UPDATE=1 cargo test --test device layout`; do not edit.
// The structs that host and kernels share; documentation is in src/shared.rs and src/shared/.

// One ray of a batch query.
typedef struct {
    float4 origin_t_min; // Origin in x, y, z (tracing space) and t_min (world units) in w.
    float4 direction_t_max; // Direction in x, y, z (world units, any length) and t_max (world units) in w.
} TraceRay;

// The nearest intersection found.
typedef struct {
    float t; // Distance in units of |direction|; infinity on a miss.
    float u; // Barycentric weight of vertex 1.
    float v; // Barycentric weight of vertex 2.
    uint primitive; // Triangle number in file order, NO_PRIMITIVE on a miss.
} Hit;

// What a ray has hit, as surfaces want to know it.
typedef struct {
    float weight0; // Weight of vertex 0.
    float u; // Weight of vertex 1.
    float v; // Weight of vertex 2.
    uint primitive; // Triangle number in file order, NO_PRIMITIVE on a miss.
} SurfaceHit;

// A kd-tree node: inner {axis, left, right, split} or leaf {KD_LEAF, first, count, 0}; 16 bytes, read as one int4.
typedef struct {
    uint flags; // Split axis, or KD_LEAF.
    uint left; // Inner: index of the child below the plane. Leaf: first reference.
    uint right; // Inner: index of the child above the plane. Leaf: number of references.
    float split; // Inner: the plane's coordinate, tracing space.
} KdNode;

// Shading data of one triangle, apart from its vertices so that traversal never reads it.
typedef struct {
    float4 normal0_u0; // Normal at vertex 0 in x, y, z (zero: use the geometric one) and texture u of vertex 0 in w.
    float4 normal1_u1; // Normal at vertex 1 and texture u of vertex 1.
    float4 normal2_u2; // Normal at vertex 2 and texture u of vertex 2.
    float v0; // Texture v of vertex 0.
    float v1; // Texture v of vertex 1.
    float v2; // Texture v of vertex 2.
    uint material; // Index of the material.
} Shading;

// A material; colours are linear RGB.
typedef struct {
    float4 ambient; // Ambient colour times the scene's ambient light in x, y, z; w unused.
    float4 diffuse; // Diffuse colour in x, y, z; w unused.
    float4 specular_shininess; // Specular colour in x, y, z and Blinn-Phong exponent in w.
    float4 mirror; // Mirror reflectance in x, y, z; w unused.
    float4 transmission_ior; // Transmission colour in x, y, z and index of refraction in w.
    float4 emission; // Emitted light in x, y, z; w unused.
    uint texture; // Index of the diffuse texture, or NO_TEXTURE.
    uint transparent; // 1 when light passes through (transmission above zero), else 0.
    uint toon_steps; // Tones above dark of the diffuse light, or 0 for smooth shading.
    float toon_threshold; // Cosine from which there is light at all; only with toon_steps.
} Material;

// A light source.
typedef struct {
    float4 position; // Position (point, spot) in x, y, z, tracing space; w unused.
    float4 direction; // Unit direction the light shines along (directional, spot) in x, y, z; w unused.
    float4 intensity; // Intensity, linear RGB; w unused.
    uint kind; // LIGHT_POINT, LIGHT_DIRECTIONAL or LIGHT_SPOT.
    float falloff_scale; // Tracing space's scale for a falloff with the squared distance in world units, 0 for none.
    float cos_inner; // Spot: cosine of the angle within which intensity is full.
    float cos_outer; // Spot: cosine of the angle beyond which there is none.
} Light;

// A texture: where its picture lies in the texel array, or the parameters of a procedural one.
typedef struct {
    // Procedural: how x of the texture's own space comes from a position (factors in x, y, z and a summand in w).
    float4 to_x;
    float4 to_y; // Procedural: the same for y.
    float4 to_z; // Procedural: the same for z.
    float4 colour0_turbulence; // Procedural: first colour in x, y, z and strength of the turbulence in w.
    float4 colour1; // Procedural: second colour in x, y, z; w unused.
    uint kind; // TEXTURE_IMAGE or the kind of procedural texture.
    uint first; // Image: index of its first texel.
    uint width; // Image: texels a row.
    uint height; // Image: rows.
    uint octaves; // Procedural: octaves of the noise.
    uint seed; // Procedural: which noise.
    // Procedural: 1 when the position is (u, v, 0) of the texture coordinates, 0 when it is the hit's in tracing space.
    uint in_uv;
    // Image: itself, and pictures of it that are half as wide and high, each behind the one before, as small as a ray
    // may want it.
    uint levels;
} TextureInfo;

// A place in a picture through which a camera ray passes.
typedef struct {
    float x; // Pixels to the right of its pixel's upper left corner; in a list of rays, of the picture's.
    float y; // Pixels down from there.
    float footprint; // Side in pixels of the square that the sample stands for.
} CameraSample;

// What the kernels need to know of the scene as a whole.
typedef struct {
    // Low corner of the box around all triangles in x, y, z, tracing space; w: the padding of the boxes of bvh2.
    float4 low;
    // High corner of that box; w: how far from 0 most triangles reach, where few others reach very much farther, else
    // 0.
    float4 high;
    float4 background_bottom; // Background straight down, linear RGB; w unused.
    float4 background_top; // Background straight up; w unused.
    float4 sky_bottom; // Light of the sky on a surface that faces down, linear RGB; w unused.
    float4 sky_top; // Light of the sky on a surface that faces up; w unused.
    float4 sky_viewer; // Light from the viewer on a surface that faces the viewer; w unused.
    float4 sky_up; // Which way is up for sky and background, length 1; w unused.
    // Length of the reference list; with brute force the number of triangles that can be hit; with instances their
    // number.
    uint reference_count;
    uint light_count; // Number of lights that shine.
    // 1 when the material of some triangle is transparent, so that shadow rays must look for the tint.
    uint has_transparent;
    float scale; // Tracing space = world units times this power of two.
} SceneParams;

// What the render kernel needs to know of the picture.
typedef struct {
    float4 eye; // Camera position in x, y, z, tracing space; w unused.
    float4 forward; // Direction to the middle of the picture, length 1; w unused.
    float4 right; // Half the picture's width at distance 1, to the right; w unused.
    float4 up; // Half the picture's height at distance 1, upwards; w unused.
    uint width; // Pixels a row.
    uint height; // Rows.
    uint sample_count; // Samples per pixel.
    uint max_depth; // Longest chain of rays, the camera ray counted as 1.
    float kill_weight; // A secondary ray whose weight is below this in every channel is not cast.
    float pixel_width; // 2 / width; for rays through corners 2 / (width - 1).
    float pixel_height; // 2 / height; for rays through corners 2 / (height - 1).
    float sample_weight; // 1 / sample_count.
    // 0, or of a list of camera rays in place of a picture how many there are. Number i, at `x + width * y` of the
    // film, passes through the position `samples[i]`, in pixels of the picture.
    uint ray_count;
    float pixel_size; // Side of a pixel at distance 1 in the middle of the picture.
    // A secondary ray of less weight lives with probability weight / this, and then weighs this; 0: all live.
    float roulette_weight;
    uint first_pixel; // Of a part of a picture the place of its first pixel in the picture: column | row << 16.
    // 0, or where each sample of a pixel is an item of its own for how many of them there is room. Another kernel adds
    // them to the pixels.
    uint samples_apart;
    uint pad_x; // Fill the struct up to a multiple of 16 bytes.
    uint pad_y; // 0.
    uint pad_z; // 0.
} RenderParams;

// A slot follows one path after the other: a sample of a pixel and all the rays that come of it.
typedef struct {
    float4 radiance; // Radiance of the path so far in x, y, z; w unused.
    uint path; // Number of the path in its batch, or NO_PATH.
    uint pending; // How many rays wait to be traced.
    uint request; // Number of this wave's texture request, where there is one.
    uint pad; // Unused.
} WavefrontSlot;

// A ray that waits to be traced. It ends nowhere.
typedef struct {
    float4 origin_t_near; // Origin in x, y, z and t_near in w.
    // What that leaves out of the origin in x, y, z and the width of the ray's cone there in w.
    float4 origin_low_width;
    // Where it lies on the triangle, as weights of the vertices, in x, y, z and by how much the cone widens in w.
    float4 start_weights_spread;
    int4 direction_skip; // Bits of the direction in x, y, z and the triangle that it starts on in w.
    int4 weight_kind_depth; // Bits of the weight in x, y, z and depth << RAY_KIND_BITS | kind in w.
} WaitingRay;

// What the lights need to know of a hit.
typedef struct {
    float4 position_error; // Position in x, y, z and bound of its error in w.
    // What that leaves out of the position in x, y, z; x of the way to where shadow rays start in w.
    float4 position_low_lift_x;
    float4 weights; // Where that is on the triangle, as weights of the vertices, in x, y, z; w unused.
    int4 geometric_normal_primitive; // Bits of the geometric normal in x, y, z and the triangle in w.
    int4 normal_material; // Bits of the shading normal in x, y, z and the material in w.
    float4 view_direction_lift_y; // Unit direction of the ray that found it in x, y, z; y of that way in w.
    float4 diffuse_lift_z; // Diffuse colour, textured, in x, y, z; z of that way in w.
} WavefrontSurface;

// What the ray of this wave brings its path.
typedef struct {
    float4 radiance; // Radiance along the ray so far in x, y, z; w unused.
    float4 weight; // What it is multiplied by in x, y, z; w unused.
} WavefrontYield;

// A ray to a light.
typedef struct {
    float4 to_light_t_far; // Direction, of the light's distance where t_far is 1, in x, y, z and t_far in w.
    int4 reflected_slot; // Bits of what the light adds where nothing is in its way in x, y, z and the slot in w.
} WavefrontShadow;

// A hit whose colour the host shall compute.
typedef struct {
    float4 direction_width; // Direction of the ray in x, y, z and the width of its cone where it hits in w.
    float weight0; // Weight of vertex 0.
    float u; // Weight of vertex 1.
    float v; // Weight of vertex 2.
    uint primitive; // The triangle that was hit.
} TextureRequest;
