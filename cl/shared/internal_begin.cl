// From here to internal_end.cl functions are a program's own. What none of its kernels calls, which is most of them, is
// then neither optimised nor kept: PoCL builds a program in two thirds of the time, and compiles its kernels from a
// fifth of the bytes.
//
// For PoCL alone (it defines this macro): of functions that are their program's own Oclgrind 21.10 makes what it cannot
// run (llvm.experimental.noalias.scope.decl).
#ifdef POCL_DEVICE_ADDRESS_BITS
#if __has_attribute(internal_linkage)
#define HAVE_INTERNAL_LINKAGE
#pragma clang attribute push(__attribute__((internal_linkage)), apply_to = function)
#endif
#endif
