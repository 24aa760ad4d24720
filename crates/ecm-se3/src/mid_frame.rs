//! Mid-frame coordinates q = (c, θ), in which exchanging equal ends of a mechanism is a symmetry.
//!
//! A = exp([θ/2]×), c = Aᵀ r − (L, 0, 0). Generalised force: Q_c = Aᵀ f,
//! Q_θ = J(θ)ᵀ τ + ½ J(θ/2)ᵀ (r × f). An energy U(q) has Q = ∂U/∂q.

use crate::jacobian::{left_jacobian_from, left_jacobian_inverse_from};
use crate::linear::{
    Mat3, Mat6, Vec3, Vec6, add, apply, apply_transposed, block, cross, dot, from_blocks, product,
    scaled, skew, sub, sum, times, transposed, transposed_product,
};
use crate::pose::{Pose, Wrench};
use crate::real::Real;
use crate::rotation::{RotationForm, rotation_matrix_from};
use crate::stumpff::Stumpff;

/// The mid frame of one pose, with the quantities that all conversions share.
#[derive(Clone, Copy, Debug)]
pub struct MidFrame<R> {
    position: Vec3<R>,
    theta: Vec3<R>,
    whole: Stumpff<R>,
    half: Stumpff<R>,
    /// A = exp([θ/2]×).
    base_from_mid: Mat3<R>,
    /// W = ½ J(θ/2): the mid frame's rotation in base axes per change of θ.
    half_jacobian: Mat3<R>,
    inverse_jacobian: Mat3<R>,
    length_m: R,
}

impl<R: Real> MidFrame<R> {
    /// The mid frame of a pose, for a mechanism of undeformed length `length_m` (m).
    #[inline]
    pub fn new(pose: &Pose<R>, length_m: R) -> Self {
        let theta = *pose.rotation_vector();
        let half_theta = scaled(R::HALF, &theta);
        let whole = Stumpff::new(dot(&theta, &theta));
        let half = Stumpff::new(dot(&half_theta, &half_theta));
        Self {
            position: *pose.position(),
            theta,
            base_from_mid: rotation_matrix_from(&half_theta, &half),
            half_jacobian: times(R::HALF, &left_jacobian_from(&half_theta, &half)),
            inverse_jacobian: left_jacobian_inverse_from(&theta, &whole),
            whole,
            half,
            length_m,
        }
    }

    /// q = (c, θ), c = Aᵀ r − (L, 0, 0), in m and rad.
    #[inline]
    pub fn coordinates(&self) -> Vec6<R> {
        let c = apply_transposed(&self.base_from_mid, &self.position);
        let t = &self.theta;
        [c[0] - self.length_m, c[1], c[2], t[0], t[1], t[2]]
    }

    /// ∂q/∂p, (6, 6): `[[Aᵀ, Aᵀ [r]× W], [0, I]]`.
    pub fn jacobian(&self) -> Mat6<R> {
        let zero = crate::linear::diagonal(R::ZERO);
        from_blocks(
            &transposed(&self.base_from_mid),
            &self.position_slope(),
            &zero,
            &crate::linear::identity(),
        )
    }

    /// `G = ∂c/∂θ = Aᵀ [r]× W`.
    #[inline(always)]
    fn position_slope(&self) -> Mat3<R> {
        transposed_product(
            &self.base_from_mid,
            &product(&skew(&self.position), &self.half_jacobian),
        )
    }

    /// Q = (Aᵀ f, J(θ)ᵀ τ + ½ J(θ/2)ᵀ (r × f)) of a wrench.
    pub fn generalised_force(&self, wrench: &Wrench<R>) -> Vec6<R> {
        let qc = apply_transposed(&self.base_from_mid, &wrench.force);
        let lever = cross(&self.position, &wrench.force);
        let qt = add(
            &apply_transposed(
                &left_jacobian_from(&self.theta, &self.whole),
                &wrench.torque,
            ),
            &apply_transposed(&self.half_jacobian, &lever),
        );
        [qc[0], qc[1], qc[2], qt[0], qt[1], qt[2]]
    }

    /// The wrench of a generalised force Q = ∂U/∂q.
    #[inline]
    pub fn wrench(&self, generalised: &Vec6<R>) -> Wrench<R> {
        let force = self.force(generalised);
        Wrench {
            force,
            torque: apply_transposed(
                &self.inverse_jacobian,
                &self.angular_force(generalised, &force),
            ),
        }
    }

    #[inline(always)]
    fn force(&self, q: &Vec6<R>) -> Vec3<R> {
        apply(&self.base_from_mid, &[q[0], q[1], q[2]])
    }

    /// J(θ)ᵀ τ = Q_θ − Wᵀ (r × f).
    #[inline(always)]
    fn angular_force(&self, q: &Vec6<R>, force: &Vec3<R>) -> Vec3<R> {
        let lever = cross(&self.position, force);
        sub(
            &[q[3], q[4], q[5]],
            &apply_transposed(&self.half_jacobian, &lever),
        )
    }

    /// H = ∂²U/∂p², symmetric, from Q = ∂U/∂q and ∂²U/∂q².
    ///
    /// H_rr = A U_cc Aᵀ, `H_rθ = A (U_cc G + U_cθ) − [f]× W`,
    /// H_θθ = U_θθ + U_θc G + Gᵀ U_cθ + Gᵀ U_cc G + ∂²(Q_c · Aᵀ r)/∂θ².
    #[inline]
    pub fn hessian(&self, generalised: &Vec6<R>, second: &Mat6<R>) -> Mat6<R> {
        let a = &self.base_from_mid;
        let g = self.position_slope();
        let (cc, ct, tt) = (
            block(second, 0, 0),
            block(second, 0, 1),
            block(second, 1, 1),
        );
        let qc = [generalised[0], generalised[1], generalised[2]];
        let force = apply(a, &qc);
        let cc_g = product(&cc, &g);
        let position = product(&product(a, &cc), &transposed(a));
        let across = {
            let carried = product(a, &sum(&cc_g, &ct));
            let turned = product(&skew(&force), &self.half_jacobian);
            crate::linear::difference(&carried, &turned)
        };
        let half_theta = scaled(R::HALF, &self.theta);
        // g(φ) = Q_c · R(φ)ᵀ r at φ = θ/2: each derivative in θ brings a factor ½.
        let form = RotationForm::with(&half_theta, &self.half, &qc, &self.position);
        let mixed = transposed_product(&ct, &g);
        let bent = transposed_product(&g, &cc_g);
        let quarter = R::HALF * R::HALF;
        let mut h = [[R::ZERO; 6]; 6];
        for i in 0..3 {
            for j in 0..3 {
                h[i][j + 3] = across[i][j];
                h[j + 3][i] = across[i][j];
            }
            for j in 0..=i {
                let p = R::HALF * (position[i][j] + position[j][i]);
                h[i][j] = p;
                h[j][i] = p;
                let angular = tt[i][j]
                    + mixed[i][j]
                    + mixed[j][i]
                    + R::HALF * (bent[i][j] + bent[j][i])
                    + quarter * form.hessian[i][j];
                h[i + 3][j + 3] = angular;
                h[j + 3][i + 3] = angular;
            }
        }
        h
    }

    /// K = ∂h/∂p of a Hessian H and the wrench there; see [`crate::stiffness`].
    #[inline]
    pub fn partial_from_generalised(&self, hessian: &Mat6<R>, wrench: &Wrench<R>) -> Mat6<R> {
        crate::stiffness::partial_from_generalised_with(
            &self.theta,
            &self.whole,
            &self.inverse_jacobian,
            hessian,
            &wrench.torque,
        )
    }
}

/// q(p) = (c, θ) of a pose, m and rad; `length_m` is the undeformed length of the mechanism.
///
/// ```
/// use ecm_se3::{Pose, mid_frame};
/// assert_eq!(mid_frame::coordinates(&Pose::at_rest(0.1), 0.1), [0.0; 6]);
/// ```
pub fn coordinates<R: Real>(pose: &Pose<R>, length_m: R) -> Vec6<R> {
    MidFrame::new(pose, length_m).coordinates()
}
