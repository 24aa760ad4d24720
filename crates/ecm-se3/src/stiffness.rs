//! The three stiffnesses of a pose-to-wrench map, and conversions between them.
//!
//! K = ∂h/∂p (partial, the paper's); H = ∂(f, Jᵀτ)/∂p (generalised, the Hessian of the
//! stored energy); K_s = K diag(I, J⁻¹) (screw, in rotation increments of base axes), whose
//! rotation block has `K_s − K_sᵀ = −[τ]×` where the mechanism is conservative.

use crate::jacobian::{left_jacobian_from, left_jacobian_inverse_from, torque_derivative_from};
use crate::linear::{
    Mat3, Mat6, Vec3, block, difference, dot, from_blocks, product, sum, transposed_product,
};
use crate::pose::{Pose, Wrench};
use crate::real::Real;
use crate::stumpff::Stumpff;

/// Kind of a stiffness matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StiffnessKind {
    /// K = ∂h/∂p.
    Partial,
    /// H = ∂(f, Jᵀτ)/∂p.
    Generalised,
    /// K_s = K diag(I, J⁻¹).
    Screw,
}

/// Converts a stiffness at `pose` and its wrench from one kind to another.
///
/// ```
/// use ecm_se3::stiffness::{StiffnessKind, convert};
/// use ecm_se3::{Pose, Wrench};
/// # fn main() -> Result<(), ecm_se3::PoseError> {
/// let pose = Pose::from_array(&[0.1, 0.0, 0.01, 0.0, 0.3, 0.0])?;
/// let wrench = Wrench::from_array(&[0.0, 0.0, 20.0, 0.0, 1.0, 0.0]);
/// let k: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 9.0 } else { 1.0 }));
/// let (partial, screw) = (StiffnessKind::Partial, StiffnessKind::Screw);
/// let k_s = convert(&k, &pose, &wrench, partial, screw);
/// let back = convert(&k_s, &pose, &wrench, screw, partial);
/// assert!((0..36).all(|n| (back[n / 6][n % 6] - k[n / 6][n % 6]).abs() < 1e-12));
/// # Ok(()) }
/// ```
pub fn convert<R: Real>(
    stiffness: &Mat6<R>,
    pose: &Pose<R>,
    wrench: &Wrench<R>,
    source: StiffnessKind,
    target: StiffnessKind,
) -> Mat6<R> {
    if source == target {
        return *stiffness;
    }
    let theta = pose.rotation_vector();
    let functions = Stumpff::new(dot(theta, theta));
    let j = left_jacobian_from(theta, &functions);
    let inverse = left_jacobian_inverse_from(theta, &functions);
    let partial = match source {
        StiffnessKind::Partial => *stiffness,
        StiffnessKind::Generalised => {
            partial_from_generalised_with(theta, &functions, &inverse, stiffness, &wrench.torque)
        }
        StiffnessKind::Screw => rotation_columns_times(stiffness, &j),
    };
    match target {
        StiffnessKind::Partial => partial,
        StiffnessKind::Generalised => {
            let d = torque_derivative_from(theta, &functions, &wrench.torque);
            from_blocks(
                &block(&partial, 0, 0),
                &block(&partial, 0, 1),
                &transposed_product(&j, &block(&partial, 1, 0)),
                &sum(&transposed_product(&j, &block(&partial, 1, 1)), &d),
            )
        }
        StiffnessKind::Screw => rotation_columns_times(&partial, &inverse),
    }
}

/// K = [[H_rr, H_rθ], [J⁻ᵀ H_θr, J⁻ᵀ (H_θθ − D)]], D = ∂(Jᵀτ)/∂θ at constant τ.
#[inline]
pub(crate) fn partial_from_generalised_with<R: Real>(
    theta: &Vec3<R>,
    functions: &Stumpff<R>,
    inverse_jacobian: &Mat3<R>,
    hessian: &Mat6<R>,
    torque: &Vec3<R>,
) -> Mat6<R> {
    let d = torque_derivative_from(theta, functions, torque);
    from_blocks(
        &block(hessian, 0, 0),
        &block(hessian, 0, 1),
        &transposed_product(inverse_jacobian, &block(hessian, 1, 0)),
        &transposed_product(inverse_jacobian, &difference(&block(hessian, 1, 1), &d)),
    )
}

/// M diag(I, J).
fn rotation_columns_times<R: Real>(m: &Mat6<R>, j: &Mat3<R>) -> Mat6<R> {
    from_blocks(
        &block(m, 0, 0),
        &product(&block(m, 0, 1), j),
        &block(m, 1, 0),
        &product(&block(m, 1, 1), j),
    )
}
