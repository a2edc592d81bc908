// Which secondary rays are cast: those of too little weight are killed, or some of them at random, which is Russian
// roulette (thesis, section 2.1.2: random killing).
// Arvo and Kirk, "Particle Transport and Image Synthesis", SIGGRAPH 1990.
//
// A ray whose weight w is less than the roulette's, W, lives with probability w / W. If it lives it weighs W: what it
// adds to its pixel is right on average, whatever comes of it. The random number is a hash of where the camera ray
// passes through the picture, which is its pixel and sample, and of the ray's way from there. So the same rays live on
// every device, in every kernel, whatever the structure and the order of the samples.
//
// Bad at few samples: what is saved in rays is paid in noise.

// 1: rays play.
#ifndef ROULETTE
#define ROULETTE 0
#endif

// What decides about the rays of a path. Without roulette only the first is read.
typedef struct {
    float kill_weight, roulette_weight; // as in RenderParams
    uint camera_ray;                    // hash_place()
} Killing;

// The hash of where a camera ray passes through the picture.
uint hash_place(CameraSample at) { return ROULETTE ? hash_word(hash_word(0u, as_uint(at.x)), as_uint(at.y)) : 0u; }

// Through a pointer, for Oclgrind 21.10: see load_point() in cl/kernels/wavefront.cl.
void begin_killing(__global const RenderParams* render, uint camera_ray, Killing* killing) {
    killing->kill_weight = render->kill_weight;
    killing->roulette_weight = ROULETTE ? render->roulette_weight : 0.0f;
    killing->camera_ray = camera_ray;
}

// With roulette a ray keeps its way in its depth: RAY_DEPTH_BITS low bits are the depth, the ones above tell of the
// last 16 surfaces whether it was refracted (1) or reflected, the last one lowest. Rays of a path that have parted
// earlier draw the same numbers. That changes no mean: a ray and those that it comes of draw others, by the depth.

// The depth without the way.
uint depth_of(uint depth) { return ROULETTE ? depth & ((1u << RAY_DEPTH_BITS) - 1u) : depth; }

// What it is of a ray of this kind that leaves where one of this depth has hit.
uint next_depth(uint depth, uint kind) {
    if (!ROULETTE) return depth + 1u;
    const uint turns = depth >> RAY_DEPTH_BITS << 1 | (kind == COUNT_REFRACTED_CAST ? 1u : 0u);
    return turns << RAY_DEPTH_BITS | (depth_of(depth) + 1u);
}

// A ray's way, as WaitingRay keeps it.
uint pack_way(uint depth, uint kind) { return depth << RAY_KIND_BITS | kind; }

// Whether a ray of weight `most` in its largest channel wins: for one of 2^23 equal parts of 0..1 whose middle is below
// most / W. So the probability is off by at most 2^-24, and the mean of a pixel by a rounding of W. All products are
// exact but the one by W, which is not subnormal, as src/options/mod.rs says; a ray that wins weighs more than 2^-24 W,
// so that W divided by its weight is a number.
bool wins_roulette(uint random, float most, float roulette) {
    return (float)(random >> 8 | 1u) * roulette < most * ROULETTE_UNITS;
}

// Whether a ray of this weight and kind is cast from where one of this depth has hit. What is below kill_weight in
// every channel could not change the pixel. Of one that has won at roulette the weight is raised.
bool survives(const Killing* killing, uint depth, uint kind, float3* weight) {
    const float most = max_component(*weight);
    if (!(most > killing->kill_weight)) return false;
    if (!ROULETTE || most >= killing->roulette_weight) return true;
    const uint random = hash_word(killing->camera_ray, pack_way(next_depth(depth, kind), kind));
    if (!wins_roulette(random, most, killing->roulette_weight)) return false;
    *weight *= killing->roulette_weight / most;
    return true;
}
