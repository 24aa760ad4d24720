//! Readings at which an exported adapter is checked, and what it makes of them.

use std::string::ToString;
use std::vec::Vec;

use ecm_se3::{Pose, Vec6};

use super::{Settings, chosen};
use crate::adapt::Reading;
use crate::error::ModelError;
use crate::export::Precision;
use crate::export::golden::{Golden, wave};
use crate::export::model::Model;

/// Readings of a mechanism whose parameters differ by half a standard deviation, with an outlier, short
/// readings, a pause, and a jump.
pub struct History {
    /// Pose, wrench and seconds of each reading: 13 numbers.
    pub readings: Vec<Vec<f64>>,
    /// What each did.
    pub outcomes: Vec<u8>,
    /// Parameters after each.
    pub values: Vec<Vec<f64>>,
    /// Variances after each.
    pub variances: Vec<Vec<f64>>,
    /// Largest difference due to rounding, of the values over their standard deviations at the start.
    pub tolerance: f64,
}

const COUNT: usize = 160;
/// Readings of a quarter of an interval; the others take a half.
const SHORT: core::ops::Range<usize> = 40..44;

impl History {
    pub fn new(
        model: &Model,
        settings: &Settings,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let points = Golden::new(model, precision)?.points;
        let rounded = |x: f64| precision.rounded(x);
        let kept = chosen(settings);
        let mut state = settings.init();
        let mut truth = settings.init();
        for (i, _, prior) in &kept {
            truth.values[*i] += 0.5 * prior.sd * wave(*i + 1, 0);
        }
        let mut history = History {
            readings: Vec::new(),
            outcomes: Vec::new(),
            values: Vec::new(),
            variances: Vec::new(),
            tolerance: match precision {
                Precision::Single => 0.02,
                Precision::Double => 1e-8,
            },
        };
        for i in 0..COUNT {
            let point = &points[i % points.len()];
            let pose = Vec6::try_from(point.as_slice())
                .ok()
                .and_then(|p| Pose::checked(&p));
            let pose = pose.ok_or_else(refused)?;
            let (h, k) = model.value_and_jacobian(point)?;
            let predicted = Vec6::try_from(h).map_err(|_| refused())?;
            let stiffness = core::array::from_fn(|a| core::array::from_fn(|j| k[6 * a + j]));
            let branches = branches(&predicted);
            if i == 60 {
                for (j, _, prior) in kept.iter().filter(|item| item.2.jumps > 0.0) {
                    truth.values[*j] = prior.start - 0.7 * prior.sd * wave(*j + 1, 0);
                }
            }
            let exact = settings.expected(&truth, &pose, &predicted, &branches, true);
            let outlier = if i == 20 { 1e4 } else { 0.0 };
            let wrench: Vec6<f64> = core::array::from_fn(|a| {
                let noise = settings.noise.wrench[a / 3] * wave(i + 1, a);
                rounded(exact[a] + noise + outlier * settings.noise.wrench[a / 3])
            });
            let dt = rounded(
                settings.interval_s
                    * match i {
                        30 => 5e4,
                        _ if SHORT.contains(&i) => 0.25,
                        _ => 0.5,
                    },
            );
            let reading = Reading {
                pose,
                wrench,
                predicted,
                stiffness,
                branches,
            };
            history
                .outcomes
                .push(settings.step(&mut state, &reading, dt) as u8);
            let row = point.iter().chain(&wrench).copied().chain([dt]);
            history.readings.push(row.collect());
            history
                .values
                .push(kept.iter().map(|item| state.values[item.0]).collect());
            let variance = |i: usize| state.covariance[i][i];
            history
                .variances
                .push(kept.iter().map(|item| variance(item.0)).collect());
        }
        Ok(history)
    }
}

/// Wrenches that stand for those of relaxing branches: 0.3 h, and 0.1 h of the next axis.
fn branches(h: &Vec6<f64>) -> [Vec6<f64>; 2] {
    [
        h.map(|x| 0.3 * x),
        core::array::from_fn(|a| 0.1 * h[(a + 1) % 6]),
    ]
}

fn refused() -> ModelError {
    ModelError::Setting {
        name: "adapt",
        found: "a model of other columns".to_string(),
        expected: "a model of all six pose and wrench columns, finite in its range",
    }
}
