//! The maps of this crate as static maps of a stepper.

use ecm_se3::{Mat6, Pose, Wrench};

use super::Elastic;
use crate::energy::EnergyModel;
use crate::pose_model::PoseModel;

impl Elastic<f64> for EnergyModel {
    fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        EnergyModel::wrench_and_stiffness(self, pose)
    }
}

impl Elastic<f64> for PoseModel {
    fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        PoseModel::wrench_and_stiffness(self, pose)
    }
}
