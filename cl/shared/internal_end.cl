// Ends what internal_begin.cl has begun: kernels must be seen from outside.
#ifdef HAVE_INTERNAL_LINKAGE
#pragma clang attribute pop
#endif
