//! Eight floats at once: by AVX2 where the CPU has it, else in plain Rust, with the same results to the last bit (so
//! without fused multiply-add).

#![allow(unsafe_code)]

use std::mem::MaybeUninit;

/// Eight lanes' worth of `T`.
pub(super) type Lanes<T> = [T; 8];

/// What traversal needs of a vector unit. A value proves that the CPU has it.
pub(super) trait Simd: Copy {
    /// Eight `f32`.
    type F: Copy;

    fn splat(self, x: f32) -> Self::F;
    fn load(self, x: &Lanes<f32>) -> Self::F;
    fn store(self, x: Self::F) -> Lanes<f32>;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `b` where the comparison involves a NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `b` where the comparison involves a NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Bit i: `a[i] <= b[i]`.
    fn at_most(self, a: Self::F, b: Self::F) -> u32;
    /// `to[i] = from[byte i of order]`; the bytes are below 8.
    fn permute(self, from: &Lanes<u32>, order: u64, to: &mut Lanes<MaybeUninit<u32>>);
    /// `to[i] = from[byte i of order]`; the bytes are below 8.
    fn permute_floats(self, from: Self::F, order: u64, to: &mut Lanes<MaybeUninit<f32>>);
    /// Begins to load `what` into the cache.
    fn prefetch<T>(self, what: &T);
}

/// Plain Rust, which the compiler may vectorise.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Simd for Portable {
    type F = Lanes<f32>;

    fn splat(self, x: f32) -> Self::F {
        [x; 8]
    }

    fn load(self, x: &Lanes<f32>) -> Self::F {
        *x
    }

    fn store(self, x: Self::F) -> Lanes<f32> {
        x
    }

    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| a[i] - b[i])
    }

    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| a[i] * b[i])
    }

    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }

    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }

    fn at_most(self, a: Self::F, b: Self::F) -> u32 {
        (0..8).fold(0, |mask, i| mask | ((a[i] <= b[i]) as u32) << i)
    }

    fn permute(self, from: &Lanes<u32>, order: u64, to: &mut Lanes<MaybeUninit<u32>>) {
        for (to, lane) in to.iter_mut().zip(order.to_le_bytes()) {
            to.write(from[lane as usize]);
        }
    }

    fn permute_floats(self, from: Self::F, order: u64, to: &mut Lanes<MaybeUninit<f32>>) {
        for (to, lane) in to.iter_mut().zip(order.to_le_bytes()) {
            to.write(from[lane as usize]);
        }
    }

    fn prefetch<T>(self, _what: &T) {}
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Lanes, MaybeUninit, Simd};
    use std::arch::x86_64::*;

    /// AVX2. Its methods are worth calling only from functions compiled for it.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(());

    impl Avx2 {
        /// A proof that the CPU has AVX2 and the bit manipulation instructions.
        pub(in super::super) fn detect() -> Option<Avx2> {
            let has = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("popcnt");
            has.then_some(Avx2(()))
        }
    }

    impl Simd for Avx2 {
        type F = __m256;

        #[inline(always)]
        fn splat(self, x: f32) -> __m256 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_set1_ps(x) }
        }

        #[inline(always)]
        fn load(self, x: &Lanes<f32>) -> __m256 {
            // SAFETY: as above; unaligned loads may read any 32 bytes that are there.
            unsafe { _mm256_loadu_ps(x.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, x: __m256) -> Lanes<f32> {
            let mut to = [0.0; 8];
            // SAFETY: as above; `to` has room for 32 bytes.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), x) };
            to
        }

        #[inline(always)]
        fn sub(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_sub_ps(a, b) }
        }

        #[inline(always)]
        fn mul(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_mul_ps(a, b) }
        }

        #[inline(always)]
        fn min(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_min_ps(a, b) }
        }

        #[inline(always)]
        fn max(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_max_ps(a, b) }
        }

        #[inline(always)]
        fn at_most(self, a: __m256, b: __m256) -> u32 {
            // SAFETY: `self` proves that the CPU has AVX2.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32 }
        }

        #[inline(always)]
        fn permute(self, from: &Lanes<u32>, order: u64, to: &mut Lanes<MaybeUninit<u32>>) {
            // SAFETY: `self` proves that the CPU has AVX2; both arrays are 32 bytes.
            unsafe {
                let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(order as i64));
                let from = _mm256_loadu_si256(from.as_ptr().cast());
                _mm256_storeu_si256(to.as_mut_ptr().cast(), _mm256_permutevar8x32_epi32(from, order));
            }
        }

        #[inline(always)]
        fn permute_floats(self, from: __m256, order: u64, to: &mut Lanes<MaybeUninit<f32>>) {
            // SAFETY: `self` proves that the CPU has AVX2; `to` is 32 bytes.
            unsafe {
                let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(order as i64));
                _mm256_storeu_ps(to.as_mut_ptr().cast(), _mm256_permutevar8x32_ps(from, order));
            }
        }

        #[inline(always)]
        fn prefetch<T>(self, what: &T) {
            let start = std::ptr::from_ref(what).cast::<i8>();
            for line in 0..size_of::<T>().div_ceil(64) {
                // SAFETY: a hint, for any address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)) };
            }
        }
    }
}
