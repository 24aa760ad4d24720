//! Rotation matrices of rotation vectors, and the bilinear form a · R(θ)ᵀ b with its derivatives.

use crate::linear::{Mat3, Vec3, add, cross, diagonal, dot, outer, scaled};
use crate::real::Real;
use crate::stumpff::Stumpff;

/// `R = exp([θ]×) = c₀ I + c₁ [θ]× + c₂ θ θᵀ` of a rotation vector (rad), |θ| ≤ π; NaN beyond |θ| = 4.
///
/// ```
/// let quarter = std::f64::consts::FRAC_PI_2;
/// let r = ecm_se3::rotation_matrix(&[0.0, 0.0, quarter]);
/// assert!((r[1][0] - 1.0).abs() < 1e-15 && r[0][0].abs() < 1e-15);
/// ```
#[inline]
pub fn rotation_matrix<R: Real>(theta: &Vec3<R>) -> Mat3<R> {
    rotation_matrix_from(theta, &Stumpff::new(dot(theta, theta)))
}

/// As [`rotation_matrix`], with given functions of |θ|².
#[inline(always)]
pub fn rotation_matrix_from<R: Real>(theta: &Vec3<R>, functions: &Stumpff<R>) -> Mat3<R> {
    let [x, y, z] = *theta;
    let c = &functions.c;
    let (sx, sy, sz) = (c[1] * x, c[1] * y, c[1] * z);
    let (tx, ty, tz) = (c[2] * x, c[2] * y, c[2] * z);
    let (xy, xz, yz) = (tx * y, tx * z, ty * z);
    let one = R::ONE;
    [
        [one - (ty * y + tz * z), xy - sz, xz + sy],
        [xy + sz, one - (tx * x + tz * z), yz - sx],
        [xz - sy, yz + sx, one - (tx * x + ty * y)],
    ]
}

/// A = exp([θ/2]×), the orientation half way between base and top.
#[inline]
pub fn half_rotation<R: Real>(theta: &Vec3<R>) -> Mat3<R> {
    rotation_matrix(&scaled(R::HALF, theta))
}

/// The scalar g(θ) = a · R(θ)ᵀ b = R(θ) a · b with its gradient and symmetric Hessian in θ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationForm<R> {
    /// g.
    pub value: R,
    /// ∂g/∂θ.
    pub gradient: Vec3<R>,
    /// ∂²g/∂θ².
    pub hessian: Mat3<R>,
}

impl<R: Real> RotationForm<R> {
    /// g of constant `a` (top axes) and `b` (base axes) at a rotation vector `theta` (rad).
    ///
    /// g = a·b + c₁ θ·n + c₂ θᵀMθ, n = a × b, M = (a bᵀ + b aᵀ)/2 − (a·b) I.
    #[inline]
    pub fn new(theta: &Vec3<R>, a: &Vec3<R>, b: &Vec3<R>) -> Self {
        Self::with(theta, &Stumpff::new(dot(theta, theta)), a, b)
    }

    /// As [`RotationForm::new`], with given functions of |θ|².
    #[inline(always)]
    pub fn with(theta: &Vec3<R>, functions: &Stumpff<R>, a: &Vec3<R>, b: &Vec3<R>) -> Self {
        let two = R::TWO;
        let four = two + two;
        let n = cross(a, b);
        let ab = dot(a, b);
        // M θ and θ·Mθ without forming M.
        let m_theta = add(
            &scaled(
                R::HALF,
                &add(&scaled(dot(b, theta), a), &scaled(dot(a, theta), b)),
            ),
            &scaled(-ab, theta),
        );
        let linear = dot(theta, &n);
        let quadratic = dot(theta, &m_theta);
        let (c1, c2) = (functions.c[1], functions.c[2]);
        let slope = functions.first(1) * linear + functions.first(2) * quadratic;
        let value = ab + c1 * linear + c2 * quadratic;
        let gradient = add(
            &add(&scaled(c1, &n), &scaled(two * c2, &m_theta)),
            &scaled(two * slope, theta),
        );
        // ∇²g = 2 c₁'(θ nᵀ + n θᵀ) + 4 c₂'(θ (Mθ)ᵀ + (Mθ) θᵀ) + 2 c₂ M
        //       + 2 (c₁' l + c₂' q) I + 4 (c₁'' l + c₂'' q) θ θᵀ
        let turning = add(
            &scaled(two * functions.first(1), &n),
            &scaled(four * functions.first(2), &m_theta),
        );
        let curvature = four * (functions.second(1) * linear + functions.second(2) * quadratic);
        let mut hessian = diagonal(two * slope - two * c2 * ab);
        let across = outer(theta, &turning);
        let along = outer(a, b);
        for i in 0..3 {
            for j in 0..=i {
                let entry = across[i][j]
                    + across[j][i]
                    + c2 * (along[i][j] + along[j][i])
                    + curvature * (theta[i] * theta[j]);
                hessian[i][j] += entry;
                if i != j {
                    hessian[j][i] = hessian[i][j];
                }
            }
        }
        Self {
            value,
            gradient,
            hessian,
        }
    }
}
