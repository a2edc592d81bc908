//! The processor's fused multiply-add, and its registers of eight numbers.

/// Compiles a function twice and calls the copy that the processor is fit for. Without this every `mul_add` on x86-64
/// is a call into the C library, some five times slower than the instruction, and loops whose turns do not depend on
/// each other are made in lanes of four in place of eight; the bits are the same.
///
/// What it calls must be inlined into it to have the instruction, or be such a function itself: `#[inline(always)]` or
/// `with_fma!`. A closure may be compiled on its own, without the instruction, and so may `map` of an array: loops and
/// functions stand in their place where there is a `mul_add`.
///
/// What is long and called from several places should be such a function: one copy of all traversals in each of their
/// callers took a compiler half of the time for the whole library.
macro_rules! with_fma {
    (
        $(#[$meta:meta])*
        $visibility:vis fn $name:ident $(<$parameter:ident: $bound:path>)? ($($argument:ident: $kind:ty),* $(,)?)
        $(-> $result:ty)? $body:block
    ) => {
        $(#[$meta])*
        $visibility fn $name $(<$parameter: $bound>)? ($($argument: $kind),*) $(-> $result)? {
            #[inline(always)]
            fn portable $(<$parameter: $bound>)? ($($argument: $kind),*) $(-> $result)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn with_fma $(<$parameter: $bound>)? ($($argument: $kind),*) $(-> $result)? {
                    portable($($argument),*)
                }
                if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
                    // SAFETY: the processor was just found to have both features.
                    return unsafe { with_fma($($argument),*) };
                }
            }
            portable($($argument),*)
        }
    };
}
pub(crate) use with_fma;
