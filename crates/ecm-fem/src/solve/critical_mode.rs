//! What gives way where a dead wrench loses its stability: the platform, or the body within.
//!
//! K_s = K_66 − K_6f K_ff⁻¹ K_f6 falls without limit where K_ff, the tangent at fixed platform, becomes
//! singular. So where the body creases, K_s is lost shortly before the pivots of K_ff, though the
//! platform hardly moves: only the mode tells this from buckling. The mode is the eigenvector δ of
//! K_s to its smallest eigenvalue with δu = −K_ff⁻¹ K_f6 δ in the body.

use super::newton::Workspace;
use super::{Fem, MOST_ACTUATORS, State};
use crate::pattern::NONE;
use crate::tensor::cross;
use nalgebra::{Matrix6, Schur};

/// Largest displacement of the platform over that of the body from which the platform gives way. In
/// columns it is 1; in the creases of 500 wrenches of the paper's Table I box at most 0.64.
const OF_THE_PLATFORM: f64 = 0.8;

/// QR iterations for the eigenvalues of a 6 × 6 matrix; some twenty are usual.
const MOST_QR_ITERATIONS: usize = 500;

/// Eigenvector to the smallest real part; that part alone where a pair is complex.
fn lowest_mode(matrix: Matrix6<f64>) -> Option<[f64; 6]> {
    let (eps, most) = (f64::EPSILON, MOST_QR_ITERATIONS);
    let values = Schur::try_new(matrix, eps, most)?.complex_eigenvalues();
    let lowest = values.iter().map(|v| v.re).fold(f64::INFINITY, f64::min);
    let shifted = matrix - Matrix6::identity() * lowest;
    let row = shifted
        .try_svd(false, true, eps, most)?
        .v_t?
        .row(5)
        .into_owned();
    Some(std::array::from_fn(|k| row[k]))
}

impl Fem {
    /// Whether the largest displacement of the critical mode lies within the body, at the state for
    /// which the workspace was computed. Where there is no mode the platform is taken.
    pub(super) fn gives_way_within(&self, work: &mut Workspace, state: &State) -> bool {
        let n = self.pattern.unknowns;
        let k_s = self.condensed(work);
        let length = self.body.mesh.length_m();
        let s = |i: usize| if i < 3 { length } else { 1.0 };
        let scaled = Matrix6::from_fn(|i, j| k_s[i][j] * s(i) * s(j));
        if !scaled.iter().all(|v| v.is_finite()) {
            return false;
        }
        let Some(mode) = lowest_mode(scaled) else {
            return false;
        };
        let delta: [f64; 6] = std::array::from_fn(|k| mode[k] * s(k));
        work.residual.fill(0.0);
        work.amount_gap = [0.0; MOST_ACTUATORS];
        if self.step(work, &delta, true).is_none() {
            return false;
        }
        let within = &work.columns[6 * n..];
        let free = self.pattern.of_displacement.iter().filter(|u| **u != NONE);
        let body = free.map(|&u| within[u as usize].abs()).fold(0.0, f64::max);
        let turn = [delta[3], delta[4], delta[5]];
        let of_node = |&node: &usize| {
            let turned = cross(turn, state.platform.arm(&self.body.mesh, node));
            (0..3)
                .map(|k| (delta[k] + turned[k]).abs())
                .fold(0.0, f64::max)
        };
        let nodes = self.pattern.platform_nodes.iter();
        nodes.map(of_node).fold(0.0, f64::max) < OF_THE_PLATFORM * body
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_lowest_mode_is_that_of_the_smallest_eigenvalue() {
        let mut matrix = Matrix6::from_diagonal(&[3.0, 2.0, -1.0, 5.0, 4.0, 6.0].into());
        // Not symmetric: the right eigenvector to −1 is then (0, 0, 2, 1, 0, 0) / √5.
        matrix[(3, 2)] = -3.0;
        let mode = lowest_mode(matrix).unwrap();
        let expected = [0.0, 0.0, 2.0, 1.0, 0.0, 0.0].map(|v: f64| v / 5.0_f64.sqrt());
        for (found, wanted) in mode.iter().zip(expected) {
            assert!(
                (found * mode[2].signum() - wanted).abs() < 1e-12,
                "{mode:?}"
            );
        }
    }
}
