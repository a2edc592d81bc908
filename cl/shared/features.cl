// What the scene needs of the kernels that shade it (src/features.rs). A condition on HAS(...) is known to the
// compiler, which leaves out all that hangs on a feature that is not there.

// Bits FEATURE_…; without a definition all.
#ifndef FEATURES
#define FEATURES 0xFFFFFFFFu
#endif
#define HAS(feature) ((FEATURES & (feature)) != 0u)
