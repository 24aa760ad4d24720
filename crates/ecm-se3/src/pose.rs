//! Poses and wrenches, and how a wrench moves between frames.

use crate::error::PoseError;
use crate::jacobian::left_jacobian;
use crate::linear::{Mat3, Vec3, Vec6, add, apply, apply_transposed, cross, dot};
use crate::real::Real;
use crate::rotation::rotation_matrix;

/// Pose of the top frame in the base frame: finite numbers, and |θ| ≤ π.
///
/// Every evaluation takes poses of this type, so that none has to check them again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose<R> {
    position: Vec3<R>,
    rotation_vector: Vec3<R>,
}

/// Force and moment on the platform at the origin of the top frame, in base axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench<R> {
    /// f (N).
    pub force: Vec3<R>,
    /// τ (N m).
    pub torque: Vec3<R>,
}

impl<R: Real> Pose<R> {
    /// From (x, y, z, θx, θy, θz) in m and rad.
    ///
    /// # Errors
    /// A number that is not finite, or |θ| > π: there a rotation has a shorter rotation vector, and
    /// models know nothing of the longer one.
    ///
    /// ```
    /// use ecm_se3::Pose;
    /// assert!(Pose::from_array(&[0.1, 0.0, 0.0, 0.0, 3.1, 0.0]).is_ok());
    /// let error = Pose::from_array(&[0.1, 0.0, 0.0, 0.0, 3.2, 0.0]).unwrap_err();
    /// assert!(error.to_string().contains("longer than pi"));
    /// ```
    #[inline(always)]
    pub fn from_array(p: &Vec6<R>) -> Result<Self, PoseError> {
        Self::checked(p).ok_or_else(|| refusal(p))
    }

    /// As [`Pose::from_array`], without the reason of a refusal and hence without double precision.
    #[inline(always)]
    pub fn checked(p: &Vec6<R>) -> Option<Self> {
        let pose = Self {
            position: [p[0], p[1], p[2]],
            rotation_vector: [p[3], p[4], p[5]],
        };
        pose.is_valid().then_some(pose)
    }

    #[inline(always)]
    fn is_valid(&self) -> bool {
        let theta = &self.rotation_vector;
        // Half a turn as a logarithm rounds it still counts as half a turn.
        let limit = R::PI * R::PI * (R::ONE + R::from_u16(8) * R::EPSILON);
        // A NaN fails the comparison.
        self.position.iter().all(|x| x.is_finite()) && dot(theta, theta) <= limit
    }

    /// r: position of the top frame's origin in the base frame (m).
    #[inline(always)]
    pub fn position(&self) -> &Vec3<R> {
        &self.position
    }

    /// θ: rotation vector of the top frame's orientation in the base frame (rad), |θ| ≤ π.
    #[inline(always)]
    pub fn rotation_vector(&self) -> &Vec3<R> {
        &self.rotation_vector
    }

    /// (x, y, z, θx, θy, θz) in m and rad.
    #[inline(always)]
    pub fn to_array(&self) -> Vec6<R> {
        joined(&self.position, &self.rotation_vector)
    }

    /// The undeformed pose of a mechanism of length `length_m`.
    pub fn at_rest(length_m: R) -> Self {
        Self {
            position: [length_m, R::ZERO, R::ZERO],
            rotation_vector: [R::ZERO; 3],
        }
    }

    /// R of the top frame in the base frame.
    pub fn base_from_top(&self) -> Mat3<R> {
        rotation_matrix(&self.rotation_vector)
    }
}

impl<R: Real> Wrench<R> {
    /// From (fx, fy, fz, τx, τy, τz) in N and N m.
    #[inline(always)]
    pub fn from_array(h: &Vec6<R>) -> Self {
        Self {
            force: [h[0], h[1], h[2]],
            torque: [h[3], h[4], h[5]],
        }
    }

    /// (fx, fy, fz, τx, τy, τz) in N and N m.
    #[inline(always)]
    pub fn to_array(&self) -> Vec6<R> {
        joined(&self.force, &self.torque)
    }

    /// The wrench in another frame by the adjoint: f' = R f, τ' = R τ + t × R f.
    ///
    /// (`rotation`, `translation`) is the pose of the old frame in the new one.
    pub fn moved(&self, rotation: &Mat3<R>, translation: &Vec3<R>) -> Self {
        let force = apply(rotation, &self.force);
        let torque = add(&apply(rotation, &self.torque), &cross(translation, &force));
        Self { force, torque }
    }

    /// ∂W/∂p = (f, J(θ)ᵀ τ): the generalised force to the pose's coordinates.
    pub fn generalised(&self, pose: &Pose<R>) -> Vec6<R> {
        let theta = apply_transposed(&left_jacobian(&pose.rotation_vector), &self.torque);
        joined(&self.force, &theta)
    }
}

/// Why six numbers are no pose.
#[cold]
fn refusal<R: Real>(p: &Vec6<R>) -> PoseError {
    match p.iter().position(|x| !x.is_finite()) {
        Some(component) => PoseError::NotFinite {
            component,
            value: p[component].to_f64(),
        },
        None => PoseError::BeyondPi {
            rotation_vector: [p[3].to_f64(), p[4].to_f64(), p[5].to_f64()],
        },
    }
}

#[inline(always)]
fn joined<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> Vec6<R> {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}
