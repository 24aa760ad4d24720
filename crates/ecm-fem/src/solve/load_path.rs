//! The load as a function of the share of the way.

use super::{Actuation, Case, Load, State};
use crate::platform::Platform;
use crate::result::CaseResult;

/// What acts beside the load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Beside {
    /// Share of the body's dead force.
    pub weight: f64,
    /// Inputs, or amounts where `amounts` says so.
    pub actuation: Actuation,
    /// Bit k: of actuator k the amount is given.
    pub amounts: u32,
}

/// From one load to another in proportion; the weight of the body and the actuation may grow beside.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoadPath {
    pub start: Case,
    pub end: Case,
    /// Share of the body's dead force at the start and at the end.
    pub weight: [f64; 2],
}

impl LoadPath {
    /// The load and what acts beside it at `share` of the way: wrenches and actuation along a
    /// straight line, poses along the screw-free path (straight origin, one rotation axis).
    pub fn at(&self, share: f64) -> (Load, Beside) {
        if share == 1.0 {
            return (
                self.end.load,
                Beside {
                    weight: self.weight[1],
                    actuation: self.end.actuation,
                    amounts: self.end.amounts,
                },
            );
        }
        let (from, to) = (&self.start.actuation, &self.end.actuation);
        let actuation = std::array::from_fn(|k| from[k] + share * (to[k] - from[k]));
        let weight = self.weight[0] + share * (self.weight[1] - self.weight[0]);
        let load = match (&self.start.load, &self.end.load) {
            (Load::Wrench(a), Load::Wrench(b)) => {
                Load::Wrench(std::array::from_fn(|k| a[k] + share * (b[k] - a[k])))
            }
            (Load::Pose(a), Load::Pose(b)) => {
                let (from, to) = (Platform::from_pose(a), Platform::from_pose(b));
                Load::Pose(from.moved(&from.step_to(&to), share).pose())
            }
            _ => self.end.load,
        };
        let amounts = self.end.amounts;
        let beside = Beside {
            weight,
            actuation,
            amounts,
        };
        (load, beside)
    }

    /// Change of the wrench, or of the pose as (δr, δφ), over the whole way.
    pub fn rate(&self) -> [f64; 6] {
        match (&self.start.load, &self.end.load) {
            (Load::Wrench(a), Load::Wrench(b)) => std::array::from_fn(|k| b[k] - a[k]),
            (Load::Pose(a), Load::Pose(b)) => {
                Platform::from_pose(a).step_to(&Platform::from_pose(b))
            }
            _ => [0.0; 6],
        }
    }

    /// Change of the weight's share and of the actuation over the whole way.
    pub fn beside_rate(&self) -> Beside {
        let (from, to) = (&self.start.actuation, &self.end.actuation);
        Beside {
            weight: self.weight[1] - self.weight[0],
            actuation: std::array::from_fn(|k| to[k] - from[k]),
            amounts: self.end.amounts,
        }
    }
}

/// The last stable state on a path, its result and its share of the way.
#[derive(Clone)]
pub(super) struct Reached {
    pub state: State,
    pub result: Option<CaseResult>,
    pub share: f64,
}
