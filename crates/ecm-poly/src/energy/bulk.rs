//! Evaluation of many poses, with the SIMD instructions of this machine.

use std::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::energy::plan::EnergyPlan;
use crate::energy::simd::SimdPlan;
use crate::error::ModelError;

/// An evaluator of one energy.
trait Evaluator: Copy {
    fn wrench<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> Wrench<f64>;
    fn stiffness<A: Arithmetic<f64>>(&self, pose: &Pose<f64>, kind: StiffnessKind) -> Mat6<f64>;
}

/// A plan with memory for `S` monomials.
#[derive(Clone, Copy)]
struct WithMemory<'a, const S: usize>(EnergyPlan<'a, f64>);

impl<const S: usize> Evaluator for WithMemory<'_, S> {
    #[inline(always)]
    fn wrench<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> Wrench<f64> {
        self.0.wrench::<A, S>(pose)
    }
    #[inline(always)]
    fn stiffness<A: Arithmetic<f64>>(&self, pose: &Pose<f64>, kind: StiffnessKind) -> Mat6<f64> {
        self.0.wrench_and_stiffness::<A, S>(pose, kind).1
    }
}

impl<const B: usize> Evaluator for SimdPlan<'_, f64, B> {
    #[inline(always)]
    fn wrench<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> Wrench<f64> {
        self.wrench::<A>(pose)
    }
    #[inline(always)]
    fn stiffness<A: Arithmetic<f64>>(&self, pose: &Pose<f64>, kind: StiffnessKind) -> Mat6<f64> {
        self.wrench_and_stiffness::<A>(pose, kind).1
    }
}

/// h of each pose.
struct Wrenches<'a, E>(E, &'a [Vec6<f64>]);

impl<E: Evaluator> Task for Wrenches<'_, E> {
    type Output = Vec<Vec6<f64>>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output {
        let mut results = Vec::with_capacity(self.1.len());
        for pose in self.1 {
            results.push(self.0.wrench::<A>(&Pose::from_array(pose)).to_array());
        }
        results
    }
}

/// The stiffness of each pose.
struct Stiffnesses<'a, E>(E, &'a [Vec6<f64>], StiffnessKind);

impl<E: Evaluator> Task for Stiffnesses<'_, E> {
    type Output = Vec<Mat6<f64>>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output {
        let mut results = Vec::with_capacity(self.1.len());
        for pose in self.1 {
            results.push(self.0.stiffness::<A>(&Pose::from_array(pose), self.2));
        }
        results
    }
}

/// h of each pose (N, N m).
///
/// # Errors
/// More monomials than the largest memory holds.
pub fn wrenches(
    plan: EnergyPlan<'_, f64>,
    poses: &[Vec6<f64>],
) -> Result<Vec<Vec6<f64>>, ModelError> {
    Ok(match plan.products.len() {
        0..128 => dispatch(Wrenches(checked::<128>(plan)?, poses)),
        128..256 => dispatch(Wrenches(checked::<256>(plan)?, poses)),
        256..1024 => dispatch(Wrenches(checked::<1024>(plan)?, poses)),
        _ => dispatch(Wrenches(checked::<4096>(plan)?, poses)),
    })
}

/// The stiffness of each pose.
///
/// # Errors
/// More monomials than the largest memory holds.
pub fn stiffnesses(
    plan: EnergyPlan<'_, f64>,
    poses: &[Vec6<f64>],
    kind: StiffnessKind,
) -> Result<Vec<Mat6<f64>>, ModelError> {
    Ok(match plan.products.len() {
        0..128 => dispatch(Stiffnesses(checked::<128>(plan)?, poses, kind)),
        128..256 => dispatch(Stiffnesses(checked::<256>(plan)?, poses, kind)),
        256..1024 => dispatch(Stiffnesses(checked::<1024>(plan)?, poses, kind)),
        _ => dispatch(Stiffnesses(checked::<4096>(plan)?, poses, kind)),
    })
}

fn checked<const S: usize>(plan: EnergyPlan<'_, f64>) -> Result<WithMemory<'_, S>, ModelError> {
    plan.check::<S>()?;
    Ok(WithMemory(plan))
}

/// h of each pose (N, N m) by SIMD.
pub fn simd_wrenches<const B: usize>(
    plan: SimdPlan<'_, f64, B>,
    poses: &[Vec6<f64>],
) -> Vec<Vec6<f64>> {
    dispatch(Wrenches(plan, poses))
}

/// The stiffness of each pose by SIMD.
pub fn simd_stiffnesses<const B: usize>(
    plan: SimdPlan<'_, f64, B>,
    poses: &[Vec6<f64>],
    kind: StiffnessKind,
) -> Vec<Mat6<f64>> {
    dispatch(Stiffnesses(plan, poses, kind))
}
