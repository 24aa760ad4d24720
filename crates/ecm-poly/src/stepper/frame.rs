//! Where memories lie: in the mid frame of a pose, or in columns that have no frame.

use ecm_se3::linear::apply;
use ecm_se3::mid_frame::MidFrame;
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench, half_rotation};

use super::Effects;

/// What carries q and Q at one pose.
pub(super) enum Frame<R> {
    Middle(MidFrame<R>),
    Columns(Vec6<R>),
}

impl<R: Real> Frame<R> {
    #[inline(always)]
    pub(super) fn new(effects: &Effects<R>, pose: &Pose<R>) -> Self {
        match effects.columns {
            Some(_) => Self::Columns(pose.to_array()),
            None => Self::Middle(MidFrame::new(pose, effects.length_m)),
        }
    }

    /// q.
    #[inline(always)]
    pub(super) fn coordinates(&self) -> Vec6<R> {
        match self {
            Self::Middle(frame) => frame.coordinates(),
            Self::Columns(p) => *p,
        }
    }

    /// Q of a wrench.
    #[inline(always)]
    pub(super) fn force(&self, wrench: &Wrench<R>) -> Vec6<R> {
        match self {
            Self::Middle(frame) => frame.generalised_force(wrench),
            Self::Columns(_) => wrench.to_array(),
        }
    }

    /// The wrench of Q.
    #[inline(always)]
    pub(super) fn wrench(&self, force: &Vec6<R>) -> Wrench<R> {
        match self {
            Self::Middle(frame) => frame.wrench(force),
            Self::Columns(_) => Wrench::from_array(force),
        }
    }

    /// d(wrench)/dp of Q with its dQ/dq.
    #[inline(always)]
    pub(super) fn carried(&self, force: &Vec6<R>, steep: &Mat6<R>) -> Mat6<R> {
        match self {
            Self::Middle(frame) => {
                let hessian = frame.hessian(force, steep);
                frame.partial_from_generalised(&hessian, &frame.wrench(force))
            }
            Self::Columns(_) => *steep,
        }
    }

    /// Whether the pose is within the limits: beyond them its load would spoil the memory for good.
    #[inline(always)]
    pub(super) fn is_near(&self, effects: &Effects<R>) -> bool {
        let q = self.coordinates();
        let [x, y, z, a, b, c] = q;
        if let Some([low, high]) = &effects.columns {
            return (0..6).all(|j| low[j] <= q[j] && q[j] <= high[j]);
        }
        effects.limits.is_none_or(|[length, angle]| {
            x * x + y * y + z * z <= length * length && a * a + b * b + c * c <= angle * angle
        })
    }
}

/// The pose of coordinates q.
#[inline(always)]
pub(super) fn pose_of<R: Real>(effects: &Effects<R>, q: &Vec6<R>) -> Vec6<R> {
    if effects.columns.is_some() {
        return *q;
    }
    let [x, y, z, a, b, c] = *q;
    let stretched = [x + effects.length_m, y, z];
    let [x, y, z] = apply(&half_rotation(&[a, b, c]), &stretched);
    [x, y, z, a, b, c]
}
