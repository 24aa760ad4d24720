//! The tables of a [`SimdPlan`], made from exponents and coefficients.

use alloc::vec::Vec;

use ecm_se3::Real;

use crate::energy::expansion::{Monomial, unscaled};
use crate::energy::invariants::Symmetry;
use crate::energy::simd::{Levels, SimdPlan};

/// Owned tables of a [`SimdPlan`] of `B` lanes.
#[derive(Clone, Debug)]
pub(crate) struct SimdTables<R, const B: usize> {
    length_m: R,
    levels: Levels,
    powers: [[u8; 3]; B],
    coefficients: Vec<[R; B]>,
}

impl<R: Real, const B: usize> SimdTables<R, B> {
    /// As [`EnergyTables::new`]; `None` for a general energy, degrees other than 4 to 8, or one
    /// that needs more lanes.
    ///
    /// [`EnergyTables::new`]: crate::energy::EnergyTables
    pub(crate) fn new(
        symmetry: Symmetry,
        degree: usize,
        exponents: &[Monomial],
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Option<Self> {
        let levels = Levels::of_degree(degree)?;
        if symmetry == Symmetry::General {
            return None;
        }
        let mut lanes: Vec<[u8; 3]> = Vec::new();
        for &[_, _, _, theta_x, a, b] in exponents {
            let key = [theta_x, a, b];
            if !lanes.contains(&key) {
                lanes.push(key);
            }
        }
        if lanes.len() > B {
            return None;
        }
        let mut powers = [[0; 3]; B];
        powers[..lanes.len()].copy_from_slice(&lanes);
        let half = degree / 2;
        let mut table = Vec::new();
        for j in (0..=half).rev() {
            for k in (0..=half - j).rev() {
                for n in (0..=degree - 2 * (j + k)).rev() {
                    let mut row = [R::ZERO; B];
                    for (e, &c) in exponents.iter().zip(coefficients) {
                        let [x, p, t, theta_x, a, b] = *e;
                        let here = [usize::from(x), usize::from(p), usize::from(t)];
                        let lane = lanes.iter().position(|l| *l == [theta_x, a, b]);
                        if let (true, Some(l)) = (here == [n, j, k], lane) {
                            row[l] = R::from_f64(c * unscaled(symmetry, e, scale));
                        }
                    }
                    table.push(row);
                }
            }
        }
        Some(Self {
            length_m: R::from_f64(length_m),
            levels,
            powers,
            coefficients: table,
        })
    }

    /// The tables, borrowed.
    pub(crate) fn plan(&self) -> SimdPlan<'_, R, B> {
        SimdPlan {
            length_m: self.length_m,
            levels: self.levels,
            powers: self.powers,
            coefficients: &self.coefficients,
        }
    }
}
