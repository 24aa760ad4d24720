//! The load as a function of the share of the way.

use super::{Load, State};
use crate::platform::Platform;
use crate::result::CaseResult;

/// From one load to another in proportion; the weight of the body may grow beside.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoadPath {
    pub start: Load,
    pub end: Load,
    /// Share of the body's dead force at the start and at the end.
    pub weight: [f64; 2],
}

impl LoadPath {
    /// The load and the share of the dead force at `share` of the way: wrenches along a straight
    /// line, poses along the screw-free path (straight origin, one rotation axis).
    pub fn at(&self, share: f64) -> (Load, f64) {
        let weight = self.weight[0] + share * (self.weight[1] - self.weight[0]);
        if share == 1.0 {
            return (self.end, self.weight[1]);
        }
        let load = match (&self.start, &self.end) {
            (Load::Wrench(a), Load::Wrench(b)) => {
                Load::Wrench(std::array::from_fn(|k| a[k] + share * (b[k] - a[k])))
            }
            (Load::Pose(a), Load::Pose(b)) => {
                let (from, to) = (Platform::from_pose(a), Platform::from_pose(b));
                Load::Pose(from.moved(&from.step_to(&to), share).pose())
            }
            _ => self.end,
        };
        (load, weight)
    }

    /// Change of the wrench, or of the pose as (δr, δφ), over the whole way.
    pub fn rate(&self) -> [f64; 6] {
        match (&self.start, &self.end) {
            (Load::Wrench(a), Load::Wrench(b)) => std::array::from_fn(|k| b[k] - a[k]),
            (Load::Pose(a), Load::Pose(b)) => {
                Platform::from_pose(a).step_to(&Platform::from_pose(b))
            }
            _ => [0.0; 6],
        }
    }

    pub fn weight_rate(&self) -> f64 {
        self.weight[1] - self.weight[0]
    }
}

/// The last stable state on a path, its result and its share of the way.
#[derive(Clone)]
pub(super) struct Reached {
    pub state: State,
    pub result: Option<CaseResult>,
    pub share: f64,
}
