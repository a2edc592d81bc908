// GENERATED from src/bounds.rs and src/shared/ by `UPDATE=1 cargo test --test device layout`; do not edit.
// The constants that host and kernels share; the rest of their documentation is there.

// Nodes and links of the structures.
#define NO_PRIMITIVE 4294967295u // `Hit::primitive` of a miss, and `skip` of a ray that skips nothing
#define KD_LEAF 3u // `KdNode::flags` of a leaf; an inner node has its split axis 0, 1 or 2 there
#define NO_ROPE 0u // A rope that leads out of the scene
#define BVH_NODE_RECORDS 4u // Records of `nodes` that a node of a binary hierarchy of boxes takes
#define BVH_LEAF 2147483648u // Bit of a link to a leaf of such a hierarchy; without it a link is a node's number
#define BVH_FIRST_MASK 134217727u // Bits of a link to a leaf that number its first reference
#define BVH_COUNT_SHIFT 27u // The bits above them, up to `BVH_LEAF`, are how many references there are
#define BVH_END 4294967295u // Where there is no more: the link of a leaf that no tree has
#define BVH_LEAVE 4294967294u // Where an instance ends: the link that leads a traversal back out of it
#define BVH8_NODE_RECORDS 16u // Records of `nodes` that a node of a hierarchy of eight children takes
#define BVH8_LINKS 12u // The first of these with links
#define BVH8_PACKET_RECORDS 18u // Records of `bounds` that a packet of eight triangles takes
#define KEY_LANE 7u // Bits of a key on the stack of such a hierarchy that are a child's number in its node
#define FIRST_KEY 4286578688u // The key of what is entered before everything: the bits of -infinity

// Records of instances.
#define INSTANCE_RECORDS 11u // Records of `bounds` that an instance takes; what they are, `src/pack/instances.rs` says
#define INSTANCE_TO_WORLD 0u // The first of these with the transform to the world
#define INSTANCE_TO_OBJECT 3u // The first with the transform from tracing space
#define INSTANCE_REACH 6u // The one with how far differences of tracing space reach in the object
#define INSTANCE_BLUR 7u // The one with the padding of its boxes whatever the ray
#define INSTANCE_NORMALS 8u // The first with the transform of normals
#define NO_MATERIAL 4294967295u // The material of an instance whose triangles have their own

// Kinds of lights and textures.
#define LIGHT_POINT 0u // `Light::kind` of a point light
#define LIGHT_DIRECTIONAL 1u // `Light::kind` of a directional light
#define LIGHT_SPOT 2u // `Light::kind` of a spot light
#define NO_TEXTURE 4294967295u // `Material::texture` of an untextured material
#define TEXTURE_IMAGE 0u // `TextureInfo::kind` of a picture
#define TEXTURE_CHECKER 1u // `TextureInfo::kind` of a chequerboard in space
#define TEXTURE_NOISE 2u // `TextureInfo::kind` of fractal noise
#define TEXTURE_MARBLE 3u // `TextureInfo::kind` of marble
#define TEXTURE_WOOD 4u // `TextureInfo::kind` of wood

// Pictures and batches: how they are divided, counted and limited.
#define PACKETS_OF_ITEM 4u // How many packets of sixteen rays, of a batch or of the camera, a work-item traces together
#define MOST_LISTED 128u // Hits of a ray up to which packets list them
#define NOT_LISTED 4294967295u // Where the hits of a ray begin that packets have not listed
// Side of the square tile of pixels that neighbouring work-items render: their rays run close together
#define TILE_SIDE 8u
#define TILE_PIXELS 64u // Pixels of a tile
#define COUNTERS 8u // How many ray counters there are
#define COUNTER_SLOTS 256u // The ray counters exist this many times on a device, so that work-items seldom meet at one
#define TAKEN_TILES 2048u // Where behind the ray counters there is how many tiles of a launch are taken
#define MAX_SHADOW_LAYERS 256u // Transparent surfaces that one shadow ray passes before it counts as blocked
#define MOST_TAPS 8u // The most places at which a texture is read along a footprint
// The kind of ray in `WaitingRay::weight_kind_depth` takes this many low bits of w, the depth the ones above
#define RAY_KIND_BITS 8u
#define RAY_DEPTH_BITS 8u // With roulette the depth takes this many of these, the ray's way the rest
#define WORK_COUNTERS 11u // How many work counters there are
// The largest radiance of one surface, or of the background, along a ray; what is brighter counts as this
#define MAX_RADIANCE 0x1p100f

// Queues of the wavefront kernels.
#define NO_PATH 4294967295u // `WavefrontSlot::path` of a slot that follows none
#define QUEUE_ACTIVE 0u // Of the lengths of the wavefront kernels' queues: slots that trace a ray in this wave
#define QUEUE_HITS 1u // Slots whose ray has hit something
#define QUEUE_TEXTURED 2u // Requests for colours of textures
#define QUEUE_PATHS 3u // Paths of the batch that were given to slots; slots that came too late count, too
#define QUEUE_RESOLVED 4u // Rays of the wave that the second pass traced
#define QUEUE_SHADOWS 5u // Shadow rays towards the first light; the other lights' follow

// Bounds of roundings, planes and hits: `cl/shared/ray.cl`.
#define EPSILON 0x1p-24f // The largest relative error of one rounding
#define WIDEN_UP 0x1.00000ap0f // More than the t of a plane is off by, upwards
#define WIDEN_DOWN 0x1.ffffecp-1f // The same downwards
#define PLANE_ERROR 0x1p-64f // What the distance of a plane from the origin is off by, however small it is
// How far a computed hit can lie outside of its triangle's box, in units of EPSILON times the vertices' distance
#define HIT_ERROR 0x1p5f
#define SLACK 0x1.4p-19f // With it the rounding of the tests of thick boxes

// Spheres: `cl/traverse/spheres.cl`.
#define SPHERE_SLACK 0x1.8p-18f // What a sphere grows by, in units of the farthest distance

// Boxes: `cl/shared/slab.cl`, those of objects behind its `INSTANCES`.
#define LEAST_SLAB_DIRECTION 0x1p-26f // The least component of a direction in slab tests
#define ORIGIN_ERROR 0x1p-22f // What slab tests are off by for a start far from 0, in units of its largest coordinate
#define LEAST_PADDING 0x1p-120f // A padding at least this thick stays in float32's range
#define FARTHEST_START 0x1p64f // From a start this far away a ray meets every box
// What slab tests in an object are off by for a start far from 0 in the scene, in units of its largest coordinate
#define TRANSFORM_ERROR 0x1p-21f
#define OBJECT_ORIGIN_ERROR 0x1.8p-21f // The same for a start far from 0 in the object
#define THICKEST 0x1p126f // With a thicker padding a ray meets every box of an object

// Distances of points: `cl/kernels/closest_point.cl`.
// What bounds of a triangle's distance are off by, in units of the distance of its farthest corner
#define DISTANCE_ERROR 0x1p-19f
#define LEAST_DISTANCE_ERROR 0x1p-60f // What they are off by, however near the triangle is
#define BOX_DISTANCE_DOWN 0x1.fffff8p-1f // What makes up for the roundings of a distance from the middle of a box
#define BOX_LIMIT_UP 0x1.00001p0f // What makes up for the roundings of squared distances of boxes
#define MOST_CANDIDATES 16u // Triangles that a point's list has room for

// Rays: `cl/shared/ray.cl`.
#define SHORT_DIRECTION 0x1p-100f // A direction whose components are all below this is lifted by LIFT
#define SMALL_TURN_LIFT 0x1p60f // What a direction is lifted by where its least component would lose bits
// What a rounded triangle test may be off from the plane of a neighbour, times the largest component of the edges
#define POINT_ERROR 0x1p-22f

// The point that a ray leaves a triangle from: `cl/shared/rounding_errors.cl`.
#define POINT_TERMS 9u // Summands of the point
#define POINT_PASSES 3u // Passes of error-free sums over them

// Vector arithmetic and elementary functions: `cl/shared/math.cl`.
#define SMALLEST_SCALED 0x1.4484cp-100f // Below this a squared length would lose bits to underflow
#define LARGEST_SCALED 0x1.bc16d6p59f // Above this a squared length would overflow
#define LIFT 0x1p64f // Brings the smallest subnormal number into the normal range
#define MOST_TURNS 0x1p22f // From so many turns on a float is a multiple of half a turn
#define SIN_13 0x1.e8f434p1f // (2 pi)^13 / 13!
#define SIN_11 (-0x1.e3075p3f) // -(2 pi)^11 / 11!
#define SIN_9 0x1.507834p5f // (2 pi)^9 / 9!
#define SIN_7 (-0x1.32d2ccp6f) // -(2 pi)^7 / 7!
#define SIN_5 0x1.466bc6p6f // (2 pi)^5 / 5!
#define SIN_3 (-0x1.4abbcep5f) // -(2 pi)^3 / 3!
#define SIN_1 0x1.921fb6p2f // 2 pi
#define LOG2_MOST 0x1.6a09e6p0f // The largest significand of which the logarithm's series is taken
#define LOG2_9 0x1.484b14p-2f // 2 / (9 ln 2)
#define LOG2_7 0x1.a61762p-2f // 2 / (7 ln 2)
#define LOG2_5 0x1.2776c6p-1f // 2 / (5 ln 2)
#define LOG2_3 0x1.ec709ep-1f // 2 / (3 ln 2)
#define LOG2_1 0x1.715476p1f // 2 / ln 2
#define EXP2_7 0x1.ffcbfcp-17f // (ln 2)^7 / 7!
#define EXP2_6 0x1.430912p-13f // (ln 2)^6 / 6!
#define EXP2_5 0x1.5d87fep-10f // (ln 2)^5 / 5!
#define EXP2_4 0x1.3b2ab6p-7f // (ln 2)^4 / 4!
#define EXP2_3 0x1.c6b08ep-5f // (ln 2)^3 / 3!
#define EXP2_2 0x1.ebfbep-3f // (ln 2)^2 / 2!
#define EXP2_1 0x1.62e43p-1f // ln 2

// Ropes: `cl/traverse/kd_ropes.cl`.
#define NO_AXIS 3u // The axis of the face that a ray has crossed last, before it has crossed one

// Errors of edge functions: `cl/intersect/edges.cl`.
#define EDGE_ERROR 0x1.ap-21f // Times extent and distance
#define EDGE_ERROR_LOW 0x1.3p-19f // The same of a ray that does not start at its origin
#define EDGE_ERROR_EXTENT 0x1p-21f // Times the extent's square
#define EDGE_ERROR2 0x1.b8p-41f // Times the distance's square
#define LEAST_EDGE 0x1p-60f // What underflows

// The first two steps of the exact test: `cl/intersect/exact_filter.cl`.
#define SPREAD_ERROR 0x1.8cccccp1f // What the error of edge functions makes of t, times the triangle's extent in depth
#define DEPTH_ERROR 0x1.ap-20f // What t is off by beside that, times the largest depth
#define LEAST_DEPTH 0x1p-64f // What underflows of it
#define DOUBLE_EPSILON 0x1p-53f // With double: the relative error of one operation
#define DOUBLE_ERROR 0x1.4p-50f // Errors of T, D, U and V
#define DOUBLE_ERROR_W 0x1.cp-50f // Those of W
#define DOUBLE_START_ERROR 0x1.99999ap27f // The error of a start's second part, in units of that of T
#define DOUBLE_LEAST_FROM 0x1p-92f // What no float is small enough for of it, in units of the relative error
#define PAIR_EPSILON 0x1p-44f // The same five with pairs of floats: the relative error of one operation
#define PAIR_ERROR 0x1.4p-41f // Errors of T, D, U and V
#define PAIR_ERROR_W 0x1.cp-41f // Those of W
#define PAIR_START_ERROR 0x1.99999ap18f // The error of a start's second part
#define PAIR_LEAST_FROM 0x1p-101f // What no float is small enough for of it
#define LEAST_MAGNITUDE 0x1p-80f // Below this a product of floats may have underflowed
#define MOST_DET_ERROR 0x1p-10f // A denominator that is off by more, relative to itself, tells no quotient
#define QUOTIENT_MARGIN 0x1.028f5cp0f // The first order of a quotient's error, times this, is more than all of it

// The last step of the exact test: `cl/intersect/exact_integers.cl`.
// Numbers from this times a power of two on have no nearest float: FLT_MAX and half of its last bit
#define INFINITE_SIGNIFICAND 33554431u
#define INFINITE_EXPONENT 103 // The power's exponent
#define QUOTIENT_BITS 34 // Bits of a quotient beside those of its positions and directions
#define COMPARISON_BITS 40 // The same of a comparison of two t

// The triangle test of the thesis: `cl/intersect/thesis.cl`.
#define THESIS_EPSILON 0x1.0c6f7ap-20f // Below this the test takes determinants and distances, in world units, for zero

// Shading: `cl/shade/normal.cl`, `light.cl`, `footprint.cl`, `texture.cl` and `roulette.cl`.
// Where all components of an interpolated normal are smaller than this, none needs to have the right sign
#define LARGEST_NORMAL_NOISE 0x1p-21f
#define TOON_HIGHLIGHT 0x1p-1f // The strength from which on a smooth highlight is one of a cartoon
#define LEAST_CONE_COSINE 0x1p-7f // What the cosine between a cone and a surface counts as at least
#define MORE_TEXELS 0x1p31f // More texels than any texture has on a side
#define ROULETTE_UNITS 0x1p24f // What 1 is in units of the random numbers of Russian roulette

// Procedural textures: `cl/shade/procedural.cl`.
#define CELL_LIMIT 0x1p31f // From here on a coordinate is in no cell of its own: no int could number it
#define HASH_X 2654435761u // Of a cell's hash: the factor of x
#define HASH_Y 2246822519u // That of y
#define HASH_Z 3266489917u // That of z
#define HASH_SEED 668265263u // That of the seed
#define HASH_FIRST 2246822507u // The first factor of the finaliser
#define HASH_SECOND 3266489909u // The second one
// By how much an octave of noise is moved against the one before
#define OCTAVE_SHIFT (float3)(0x1.a36a94p-1f, 0x1.579306p-1f, 0x1.197258p-1f)
#define EARLY_WOOD 0x1.b33334p-1f // Share of a year's ring that is early wood
#define WOOD_NOISE (float3)(0x1p-2f, 0x1p-5f, 0x1p-2f) // The frequencies of the noise that bends the rings
// How far beneath the surface a solid texture is looked at, times the triangle's largest coordinate
#define SOLID_DEPTH 0x1.8p-21f

// Counters of rays and of work, and what a scene needs of kernels.
#define COUNT_CAMERA_CAST 0u
#define COUNT_CAMERA_HIT 1u
#define COUNT_SHADOW_CAST 2u
#define COUNT_SHADOW_HIT 3u
#define COUNT_REFLECTED_CAST 4u
#define COUNT_REFLECTED_HIT 5u
#define COUNT_REFRACTED_CAST 6u
#define COUNT_REFRACTED_HIT 7u
#define WORK_STEPS 0u
#define WORK_LEAVES 1u
#define WORK_EMPTY_LEAVES 2u
#define WORK_TESTS 3u
#define WORK_EXTENDED_TESTS 4u
#define WORK_CLOSE_TESTS 5u
#define WORK_RESTARTS 6u
#define WORK_OVERFLOWS 7u
#define WORK_NODE_BYTES 8u
#define WORK_TRIANGLE_BYTES 9u
#define WORK_DEEPEST_STACK 10u
#define FEATURE_IMAGE_TEXTURES 1u
#define FEATURE_PROCEDURAL_TEXTURES 2u
#define FEATURE_SMOOTH_NORMALS 4u
#define FEATURE_MIRRORS 8u
#define FEATURE_TRANSPARENCY 16u
#define FEATURE_HIGHLIGHTS 32u
#define FEATURE_TOON 64u
#define FEATURE_PLACED_LIGHTS 128u
#define FEATURE_DIRECTIONAL_LIGHTS 256u
#define FEATURE_SPOTS 512u
#define FEATURE_FALLOFF 1024u
#define FEATURE_SEVERAL_LIGHTS 2048u
#define FEATURE_SEVERAL_MATERIALS 4096u
#define FEATURE_SKY 8192u
