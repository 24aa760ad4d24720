//! Many poses at once, with the instructions that this machine has.

use std::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6};

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::energy::lanes::LanePlan;
use crate::energy::plan::EnergyPlan;
use crate::error::ModelError;

/// h of each pose.
pub fn wrenches(
    plan: EnergyPlan<'_, f64>,
    poses: &[Vec6<f64>],
) -> Result<Vec<Vec6<f64>>, ModelError> {
    Ok(match plan.products.len() {
        0..128 => run::<Wrenches<128>>(plan, poses, Wrenches)?,
        128..256 => run::<Wrenches<256>>(plan, poses, Wrenches)?,
        256..1024 => run::<Wrenches<1024>>(plan, poses, Wrenches)?,
        _ => run::<Wrenches<4096>>(plan, poses, Wrenches)?,
    })
}

/// The stiffness of each pose.
pub fn stiffnesses(
    plan: EnergyPlan<'_, f64>,
    poses: &[Vec6<f64>],
    kind: StiffnessKind,
) -> Result<Vec<Mat6<f64>>, ModelError> {
    Ok(match plan.products.len() {
        0..128 => run::<Stiffnesses<128>>(plan, poses, Stiffnesses(kind))?,
        128..256 => run::<Stiffnesses<256>>(plan, poses, Stiffnesses(kind))?,
        256..1024 => run::<Stiffnesses<1024>>(plan, poses, Stiffnesses(kind))?,
        _ => run::<Stiffnesses<4096>>(plan, poses, Stiffnesses(kind))?,
    })
}

/// What is computed of one pose.
trait Evaluation: Copy {
    type Output;
    fn check(plan: &EnergyPlan<'_, f64>) -> Result<(), ModelError>;
    fn at<A: Arithmetic<f64>>(self, plan: &EnergyPlan<'_, f64>, pose: &Pose<f64>) -> Self::Output;
}

#[derive(Clone, Copy)]
struct Wrenches<const S: usize>;

impl<const S: usize> Evaluation for Wrenches<S> {
    type Output = Vec6<f64>;
    fn check(plan: &EnergyPlan<'_, f64>) -> Result<(), ModelError> {
        Ok(plan.check::<S>()?)
    }
    #[inline(always)]
    fn at<A: Arithmetic<f64>>(self, plan: &EnergyPlan<'_, f64>, pose: &Pose<f64>) -> Vec6<f64> {
        plan.wrench::<A, S>(pose).to_array()
    }
}

#[derive(Clone, Copy)]
struct Stiffnesses<const S: usize>(StiffnessKind);

impl<const S: usize> Evaluation for Stiffnesses<S> {
    type Output = Mat6<f64>;
    fn check(plan: &EnergyPlan<'_, f64>) -> Result<(), ModelError> {
        Ok(plan.check::<S>()?)
    }
    #[inline(always)]
    fn at<A: Arithmetic<f64>>(self, plan: &EnergyPlan<'_, f64>, pose: &Pose<f64>) -> Mat6<f64> {
        plan.wrench_and_stiffness::<A, S>(pose, self.0).1
    }
}

struct Rows<'a, E> {
    plan: EnergyPlan<'a, f64>,
    poses: &'a [Vec6<f64>],
    evaluation: E,
}

impl<E: Evaluation> Task for Rows<'_, E> {
    type Output = Vec<E::Output>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Vec<E::Output> {
        let mut results = Vec::with_capacity(self.poses.len());
        for pose in self.poses {
            let pose = Pose::from_array(pose);
            results.push(self.evaluation.at::<A>(&self.plan, &pose));
        }
        results
    }
}

fn run<E: Evaluation>(
    plan: EnergyPlan<'_, f64>,
    poses: &[Vec6<f64>],
    evaluation: E,
) -> Result<Vec<E::Output>, ModelError> {
    E::check(&plan)?;
    Ok(dispatch(Rows {
        plan,
        poses,
        evaluation,
    }))
}

/// h of each pose, in lanes.
pub fn wrenches_in_lanes<const B: usize>(
    plan: LanePlan<'_, f64, B>,
    poses: &[Vec6<f64>],
) -> Vec<Vec6<f64>> {
    dispatch(LaneWrenches { plan, poses })
}

/// The stiffness of each pose, in lanes.
pub fn stiffnesses_in_lanes<const B: usize>(
    plan: LanePlan<'_, f64, B>,
    poses: &[Vec6<f64>],
    kind: StiffnessKind,
) -> Vec<Mat6<f64>> {
    dispatch(LaneStiffnesses { plan, poses, kind })
}

struct LaneWrenches<'a, const B: usize> {
    plan: LanePlan<'a, f64, B>,
    poses: &'a [Vec6<f64>],
}

impl<const B: usize> Task for LaneWrenches<'_, B> {
    type Output = Vec<Vec6<f64>>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output {
        let mut results = Vec::with_capacity(self.poses.len());
        for pose in self.poses {
            results.push(self.plan.wrench::<A>(&Pose::from_array(pose)).to_array());
        }
        results
    }
}

struct LaneStiffnesses<'a, const B: usize> {
    plan: LanePlan<'a, f64, B>,
    poses: &'a [Vec6<f64>],
    kind: StiffnessKind,
}

impl<const B: usize> Task for LaneStiffnesses<'_, B> {
    type Output = Vec<Mat6<f64>>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output {
        let mut results = Vec::with_capacity(self.poses.len());
        for pose in self.poses {
            let pose = Pose::from_array(pose);
            results.push(self.plan.wrench_and_stiffness::<A>(&pose, self.kind).1);
        }
        results
    }
}
