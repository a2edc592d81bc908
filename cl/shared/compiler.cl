// What every compiler is told before all else: the arithmetic is to be done as it is written.
//
// A product and a sum must not be fused, sums not be regrouped, divisions not become products, and NaN, infinity and -0
// not be assumed away, whatever options the program is built with: rounded results would change, and with them hits.
#if defined(__NV_CL_C_VERSION) && defined(__FAST_RELAXED_MATH__)
// Divisions and square roots are no longer rounded correctly, whatever else is asked for.
#error "cannot be protected against -cl-fast-relaxed-math; use -cl-unsafe-math-optimizations -cl-finite-math-only"
#endif
#ifdef __clang__
#if defined(__SPIR__) || defined(__SPIRV__)
// Compilers that go through SPIR or SPIR-V ignore float_control. What is left protects against
// -cl-unsafe-math-optimizations and -cl-no-signed-zeros as far as the kernels go, and Intel's against
// -cl-finite-math-only; -cl-fast-relaxed-math makes Intel's take every NaN for a number.
#ifdef __FAST_RELAXED_MATH__
#error "cannot be protected against -cl-fast-relaxed-math; use -cl-unsafe-math-optimizations -cl-finite-math-only"
#endif
#if __clang_major__ >= 18
#pragma clang fp reassociate(off) reciprocal(off)
#elif __clang_major__ >= 12
#pragma clang fp reassociate(off)
#endif
#elif __clang_major__ >= 12
// Against all of them. It allows contraction, which FP_CONTRACT takes back.
#pragma float_control(precise, on)
#endif
#endif
#pragma OPENCL FP_CONTRACT OFF

// For a function of an innermost loop that must not be a call, and for one that few others call on the way from a
// kernel to the end of the exact test. PoCL 3.1 collects a kernel's functions by following every chain of calls there
// is, again and again: each link doubles them. Without optimisation, as many tests compile their kernels, those of
// batches had 400,000, which took half of the time. Not for functions that return a struct: Oclgrind 21.10 does not
// know what clang tells of it where they are inlined.
#define INLINE __attribute__((always_inline))

// For a large function with several callers. NVIDIA's compiler copies it to each, which makes the second pass, where
// everything is tried, twice as long to compile as it need be, for no speed: few rays go that way. In the first pass
// calls would cost up to half of the speed. For the same reason it is not to unroll the loop over the triangles there.
//
// Where lanes part around a call they meet again at one of twelve barriers. For a chain of calls that takes more,
// NVIDIA's compiler keeps some in registers, and an H200 then failed with illegal addresses. So chains are to be short,
// in first passes above all: no BMOV.32.CLEAR to a register in what nvdisasm tells of a kernel.
#if defined(__NV_CL_C_VERSION) && defined(RESOLVE_DEFERRED)
#define ONE_COPY __attribute__((noinline))
#define NO_UNROLLING _Pragma("unroll 1")
#else
#define ONE_COPY
#define NO_UNROLLING
#endif

// Asks for memory that is read soon, where that is a processor's instruction: its own guesses end with the order of
// addresses. OpenCL's prefetch() does nothing in PoCL.
#if defined(__clang__) && (defined(__x86_64__) || defined(__aarch64__))
#define PREFETCH(pointer) __builtin_prefetch((const void*)(uintptr_t)(pointer))
#else
#define PREFETCH(pointer)
#endif

// PoCL tells the user's terminal how many warnings there were; these two are about nothing.
#if defined(__clang__) && defined(__has_warning)
// Sixteen lanes are passed in two registers without AVX-512: no other compiler calls these functions.
#if __has_warning("-Wpsabi")
#pragma clang diagnostic ignored "-Wpsabi"
#endif
#if __has_warning("-Wconstant-logical-operand") // HAS(...) is a constant, which is what it is for
#pragma clang diagnostic ignored "-Wconstant-logical-operand"
#endif
#endif

// Intel's runtime for CPUs (2026.22) runs several work-items in the lanes of a vector. A function that is not inlined
// and takes a float3, by value or in a struct, then sees the argument of the first lane in all of them. A hint of one
// lane per vector switches that off; only this runtime has the extension. The attribute belongs to every kernel, so it
// comes with the keyword.
#ifdef cl_intel_vec_len_hint
#define __kernel __attribute__((intel_vec_len_hint(1))) kernel
#endif
