//! e^(−x) for x ≥ 0 without libm, in the two forms that an exact step needs.

use ecm_se3::Real;

const DOUBLINGS: u16 = 10;
/// Beyond it e^(−x) is below half a unit in the last place of 1.
const LARGEST: u16 = 64;
const TERMS: usize = 9;

/// What a branch loses in x = dt/τ, and what is left of a ramp that took as long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decay<R> {
    /// 1 − e^(−x).
    pub lost: R,
    /// (1 − e^(−x)) / x; 1 at x = 0, a sudden move.
    pub share: R,
}

impl<R: Real> Decay<R> {
    /// At x ≥ 0, also where it is infinite.
    ///
    /// 1 − e^(−x) by its series at x/1024, then ten times s → s (2 − s): a doubling adds no more than
    /// a rounding, so that a small loss keeps all its digits.
    #[inline]
    pub fn new(x: R) -> Self {
        if x < R::EPSILON {
            return Self {
                lost: x,
                share: R::ONE,
            };
        }
        let largest = R::from_u16(LARGEST);
        let y = if x < largest { x } else { largest } / R::from_u16(1 << DOUBLINGS);
        let mut sum = R::ZERO;
        for k in (1..=TERMS).rev() {
            sum = R::INVERSE_FACTORIALS[k] - y * sum;
        }
        let mut lost = y * sum;
        for _ in 0..DOUBLINGS {
            lost = lost * (R::TWO - lost);
        }
        Self {
            lost,
            share: lost / x,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_exponential_in_both_precisions() {
        for i in -400..=120 {
            let x = 10f64.powf(f64::from(i) / 20.0);
            let exact = -(-x).exp_m1();
            let found = Decay::new(x);
            assert!((found.lost / exact - 1.0).abs() < 4e-15, "{x}: {found:?}");
            assert!(
                (found.share * x / exact - 1.0).abs() < 4e-15,
                "{x}: {found:?}"
            );
            let single = Decay::new(x as f32);
            assert!(
                (f64::from(single.lost) / exact - 1.0).abs() < 2e-6,
                "{x}: {single:?}"
            );
        }
    }

    #[test]
    fn no_time_loses_nothing_and_all_time_loses_everything() {
        assert_eq!((Decay::new(0.0).lost, Decay::new(0.0).share), (0.0, 1.0));
        for x in [65.0, 1e300, f64::INFINITY] {
            assert_eq!(Decay::new(x).lost, 1.0);
            assert!(Decay::new(x).share * x.min(1e300) <= 1.0);
        }
    }
}
