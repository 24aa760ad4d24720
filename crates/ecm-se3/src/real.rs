//! The number types of this crate: `f64` and `f32`.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f64 {}
    impl Sealed for f32 {}
}

/// A real number with the arithmetic of a microcontroller, without libm.
pub trait Real:
    Copy
    + PartialOrd
    + Debug
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + sealed::Sealed
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// 1/2.
    const HALF: Self;
    /// 2.
    const TWO: Self;
    /// π.
    const PI: Self;
    /// The gap between 1 and the next number.
    const EPSILON: Self;
    /// Not a number.
    const NAN: Self;
    /// Terms of the series of [`crate::Stumpff`] that reach this type's precision at |θ| = π.
    const SERIES_TERMS: usize;
    /// Whether it is neither NaN nor infinite.
    fn is_finite(self) -> bool;
    /// 1/n! for n = 0 … 34.
    const INVERSE_FACTORIALS: [Self; 35];
    /// A whole number, without double precision on the way.
    fn from_u16(value: u16) -> Self;
    /// The nearest number of this type.
    fn from_f64(value: f64) -> Self;
    /// The same number in double precision.
    fn to_f64(self) -> f64;
    /// The nearest number from `low` to `high`; of NaN itself.
    #[inline(always)]
    fn clamped(self, low: Self, high: Self) -> Self {
        if self < low {
            low
        } else if self > high {
            high
        } else {
            self
        }
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const HALF: Self = 0.5;
    const TWO: Self = 2.0;
    const PI: Self = core::f64::consts::PI;
    const EPSILON: Self = f64::EPSILON;
    const NAN: Self = f64::NAN;
    const SERIES_TERMS: usize = 13;
    const INVERSE_FACTORIALS: [Self; 35] = inverse_factorials();
    #[inline(always)]
    fn from_u16(value: u16) -> Self {
        f64::from(value)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const HALF: Self = 0.5;
    const TWO: Self = 2.0;
    const PI: Self = core::f32::consts::PI;
    const EPSILON: Self = f32::EPSILON;
    const NAN: Self = f32::NAN;
    const SERIES_TERMS: usize = 7;
    const INVERSE_FACTORIALS: [Self; 35] = single(inverse_factorials());
    #[inline(always)]
    fn from_u16(value: u16) -> Self {
        f32::from(value)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

const fn inverse_factorials() -> [f64; 35] {
    let mut table = [1.0; 35];
    // The factorial is exact up to 22!; beyond it the relative error stays below 1e-15.
    let mut factorial = 1.0;
    let mut n = 1;
    while n < 35 {
        factorial *= n as f64;
        table[n] = 1.0 / factorial;
        n += 1;
    }
    table
}

/// Rounded by the compiler, so that no conversion remains in the program.
const fn single(table: [f64; 35]) -> [f32; 35] {
    let mut rounded = [0.0; 35];
    let mut n = 0;
    while n < 35 {
        rounded[n] = table[n] as f32;
        n += 1;
    }
    rounded
}
