//! The entire functions c_k(s) = Σ_j (−s)ʲ / (2j + k)! in place of sines and cosines.
//!
//! With s = a²: c₀ = cos a, c₁ = sin a / a, c₂ = (1 − cos a)/a², c₃ = (a − sin a)/a³, …
//! They have no singular point, so nothing branches at a = 0.
//! Source: K. Stumpff, Himmelsmechanik I (1959), chapter 5.

use crate::real::Real;

/// Largest s = |θ|².
const LARGEST: u16 = 16;

/// c₀ … c₇ at one s = |θ|².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stumpff<R> {
    /// c_k(s) by k.
    pub c: [R; 8],
}

impl<R: Real> Stumpff<R> {
    /// c_k at `s` = |θ|² (rad²).
    ///
    /// c₆ and c₇ by their series, the others by c_k = 1/k! − s c_{k+2}, which loses no digit
    /// that counts up to |θ| = π. Beyond |θ| = 4, where the series are too short, all are NaN: no
    /// wrong rotation passes for a right one.
    #[inline]
    pub fn new(s: R) -> Self {
        let s = if s <= R::from_u16(LARGEST) { s } else { R::NAN };
        let mut c = [R::ZERO; 8];
        c[6] = series(6, s);
        c[7] = series(7, s);
        let mut k = 6;
        while k > 0 {
            k -= 1;
            c[k] = R::INVERSE_FACTORIALS[k] - s * c[k + 2];
        }
        Self { c }
    }

    /// dc_k/ds = (k c_{k+2} − c_{k+1}) / 2 for k ≤ 5; NaN for others, whose c_{k+2} is not here.
    #[inline(always)]
    pub fn first(&self, k: usize) -> R {
        match k {
            0..=5 => R::HALF * (R::from_u16(k as u16) * self.c[k + 2] - self.c[k + 1]),
            _ => R::NAN,
        }
    }

    /// d²c_k/ds² for k ≤ 3; NaN for others.
    #[inline(always)]
    pub fn second(&self, k: usize) -> R {
        match k {
            0..=3 => R::HALF * (R::from_u16(k as u16) * self.first(k + 2) - self.first(k + 1)),
            _ => R::NAN,
        }
    }
}

#[inline(always)]
fn series<R: Real>(k: usize, s: R) -> R {
    let mut value = R::ZERO;
    let mut j = R::SERIES_TERMS;
    while j > 0 {
        j -= 1;
        value = R::INVERSE_FACTORIALS[2 * j + k] - s * value;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agree_with_sines_and_cosines_up_to_pi() {
        for i in 1..=64 {
            let a = core::f64::consts::PI * f64::from(i) / 64.0;
            let stumpff = Stumpff::new(a * a);
            let direct = [
                a.cos(),
                a.sin() / a,
                2.0 * (0.5 * a).sin().powi(2) / (a * a),
            ];
            for k in 0..3 {
                assert!((stumpff.c[k] - direct[k]).abs() < 1e-15, "c{k}({a})");
            }
            if a > 1.0 {
                assert!((stumpff.c[3] - (a - a.sin()) / a.powi(3)).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn single_precision_follows_double() {
        for i in 0..=64 {
            let a = core::f64::consts::PI * f64::from(i) / 64.0;
            let double = Stumpff::new(a * a);
            let single = Stumpff::new((a * a) as f32);
            for k in 0..8 {
                assert!((double.c[k] - f64::from(single.c[k])).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn beyond_the_series_there_is_no_number() {
        for s in [16.1, 1e300, f64::INFINITY, f64::NAN] {
            assert!(Stumpff::new(s).c.iter().all(|c| c.is_nan()), "{s}");
            assert!(Stumpff::new(s as f32).c.iter().all(|c| c.is_nan()), "{s}");
        }
        assert!(Stumpff::new(16.0).c.iter().all(|c| c.is_finite()));
    }

    #[test]
    fn derivatives_by_finite_differences() {
        let (s, e) = (2.3_f64, 1e-4);
        let (low, mid, high) = (Stumpff::new(s - e), Stumpff::new(s), Stumpff::new(s + e));
        for k in 0..4 {
            assert!((mid.first(k) - (high.c[k] - low.c[k]) / (2.0 * e)).abs() < 1e-9);
            assert!((mid.second(k) - (high.first(k) - low.first(k)) / (2.0 * e)).abs() < 1e-9);
        }
    }
}
