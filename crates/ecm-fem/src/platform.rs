//! The rigid top: six unknowns in front of all nodes of its face.
//!
//! Node a follows x_a = r + R (X_a − X_top), so δx_a = δr + δφ × d_a with
//! d_a = R (X_a − X_top). The wrench is h = (Σ f_a, Σ d_a × f_a). Its tangent by
//! (δr, δφ) has, beside the nodes' stiffness, the geometric term Σ [f_a]× [d_a]× in
//! the rotation block: `K_s − K_sᵀ = −[τ]×` there.

use crate::mesh::Mesh;
use crate::tensor::{Mat3, apply, cross, norm, product, skew, transpose};
use ecm_se3::rotation_matrix;

/// Where the platform is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Platform {
    /// Its origin in the base frame, m.
    pub position_m: [f64; 3],
    /// base_from_top.
    pub rotation: Mat3,
}

impl Platform {
    /// At rest.
    pub fn at_rest(length_m: f64) -> Self {
        Self {
            position_m: [length_m, 0.0, 0.0],
            rotation: crate::tensor::IDENTITY,
        }
    }

    /// From (x, y, z, θx, θy, θz).
    pub fn from_pose(pose: &[f64; 6]) -> Self {
        Self {
            position_m: [pose[0], pose[1], pose[2]],
            rotation: rotation_matrix(&[pose[3], pose[4], pose[5]]),
        }
    }

    /// (x, y, z, θx, θy, θz), |θ| ≤ π.
    pub fn pose(&self) -> [f64; 6] {
        let t = self.rotation_vector();
        let r = self.position_m;
        [r[0], r[1], r[2], t[0], t[1], t[2]]
    }

    /// θ (rad), |θ| ≤ π; NaN where an iteration has lost the rotation.
    pub fn rotation_vector(&self) -> [f64; 3] {
        rotation_vector(&self.rotation)
    }

    /// R (X − X_top) of a node.
    pub fn arm(&self, mesh: &Mesh, node: usize) -> [f64; 3] {
        let x = mesh.nodes_m()[node];
        apply(&self.rotation, [x[0] - mesh.length_m(), x[1], x[2]])
    }

    /// Displacement of a node that moves with the platform.
    pub fn displacement(&self, mesh: &Mesh, node: usize) -> [f64; 3] {
        let (d, x) = (self.arm(mesh, node), mesh.nodes_m()[node]);
        [0, 1, 2].map(|k| self.position_m[k] + d[k] - x[k])
    }

    /// Moved by `share` × (δr, δφ): r + share δr, exp(share δφ) R.
    pub fn moved(&self, step: &[f64; 6], share: f64) -> Self {
        let turn = rotation_matrix(&[share * step[3], share * step[4], share * step[5]]);
        Self {
            position_m: [0, 1, 2].map(|k| self.position_m[k] + share * step[k]),
            rotation: product(&turn, &self.rotation),
        }
    }

    /// (δr, δφ) that takes `self` to `target` along the shortest way.
    pub fn step_to(&self, target: &Self) -> [f64; 6] {
        let phi = rotation_vector(&product(&target.rotation, &transpose(&self.rotation)));
        let r = [0, 1, 2].map(|k| target.position_m[k] - self.position_m[k]);
        [r[0], r[1], r[2], phi[0], phi[1], phi[2]]
    }

    /// Wrench (f, τ) of nodal forces about the platform's origin, and Σ [f_a]× [d_a]×.
    pub fn wrench(&self, mesh: &Mesh, nodes: &[usize], force: &[f64]) -> ([f64; 6], Mat3) {
        let mut wrench = [0.0; 6];
        let mut geometric = [[0.0; 3]; 3];
        for &node in nodes {
            let d = self.arm(mesh, node);
            let f = [0, 1, 2].map(|k| force[3 * node + k]);
            let moment = cross(d, f);
            let term = product(&skew(f), &skew(d));
            for k in 0..3 {
                wrench[k] += f[k];
                wrench[3 + k] += moment[k];
                for j in 0..3 {
                    geometric[k][j] += term[k][j];
                }
            }
        }
        (wrench, geometric)
    }
}

/// Size of a step for limits: the larger of |δr| / length and |δφ|.
pub fn step_size(step: &[f64; 6], length_m: f64) -> f64 {
    let (r, phi) = ([step[0], step[1], step[2]], [step[3], step[4], step[5]]);
    (norm(r) / length_m).max(norm(phi))
}

/// θ = log R (rad) of a product of rotations; NaN where it is none any more.
pub fn rotation_vector(rotation: &Mat3) -> [f64; 3] {
    ecm_se3::rotation_vector(rotation).unwrap_or([f64::NAN; 3])
}
