//! A history of steps at which an export with effects of time is checked.

use std::string::ToString;
use std::vec::Vec;

use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::error::ModelError;
use crate::export::Precision;
use crate::export::golden::{Golden, wave};
use crate::export::model::Model;
use crate::export::reach::Reach;
use crate::stepper::{Effects, Elastic, Inputs, Stepper};

/// One step: what the code is told, and what it must say.
pub struct Step {
    /// Measured pose.
    pub pose: Vec<f64>,
    /// Seconds since the step before.
    pub dt: f64,
    /// Temperature (°C) and age (s).
    pub inputs: [f64; 2],
    /// h.
    pub wrench: Vec<f64>,
    /// ∂h/∂p of the step.
    pub tangent: Vec<f64>,
}

/// Steps between the golden poses: from sudden moves to a pause of an hour, and rests.
pub struct History {
    /// In their order; the first is at the pose of the start.
    pub steps: Vec<Step>,
    /// Largest difference due to rounding, of wrenches and of their derivatives.
    pub tolerance: [f64; 2],
}

const DTS: [f64; 7] = [0.0, 1e-3, 0.1, 1e-3, 1.0, 20.0, 3600.0];

impl History {
    /// The history of a model of six pose and six wrench columns, or of one and one.
    pub fn new(
        model: &Model,
        reach: Option<&Reach>,
        effects: &Effects<f64>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let points = Golden::within(model, reach, precision)?.points;
        if model.shape() != (1, 1) {
            return Self::along(&points, model, effects, precision);
        }
        let mut first = *effects;
        // The limits of a single coordinate are none of a pose; golden points are within them.
        (first.length_m, first.limits) = (0.0, None);
        Self::along(&points, &FirstOfSix(model), &first, precision)
    }

    /// Each point twice: after the move a rest.
    fn along(
        points: &[Vec<f64>],
        model: &impl Elastic<f64>,
        effects: &Effects<f64>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let stepper = Stepper {
            model,
            effects: *effects,
        };
        let n = points.first().map_or(0, Vec::len);
        let pose = |point: &[f64]| {
            let number = |j| point.get(j).copied().unwrap_or(0.0);
            Pose::checked(&core::array::from_fn(number))
        };
        let start = points.first().and_then(|point| stepper.init(&pose(point)?));
        let mut state = start.ok_or_else(refused)?;
        let rounded = |x: f64| precision.rounded(x);
        let (mut steps, mut largest) = (Vec::new(), [0.0_f64; 2]);
        for i in 0..2 * points.len() {
            let point = points[i / 2].clone();
            let dt = rounded(DTS[i % DTS.len()]);
            let inputs = [
                effects.reference_degc + 5.0 * wave(i, 0),
                1e4 + 1e4 * wave(i, 1),
            ];
            let inputs = inputs.map(rounded);
            let told = Inputs {
                temperature_degc: inputs[0],
                age_s: inputs[1],
            };
            let at = pose(&point);
            let found = at.and_then(|pose| stepper.step(&mut state, &pose, dt, &told));
            let (h, k) = found.ok_or_else(refused)?;
            let wrench = h.to_array()[..n].to_vec();
            let tangent: Vec<f64> = k[..n].iter().flat_map(|row| row[..n].to_vec()).collect();
            for (size, values) in largest.iter_mut().zip([&wrench, &tangent]) {
                *size = values.iter().fold(*size, |m, x| m.max(x.abs()));
            }
            steps.push(Step {
                pose: point,
                dt,
                inputs,
                wrench,
                tangent,
            });
        }
        let share = match precision {
            Precision::Single => 1e-3,
            Precision::Double => 1e-11,
        };
        Ok(History {
            steps,
            tolerance: largest.map(|size| size.max(1e-12) * share),
        })
    }
}

fn refused() -> ModelError {
    ModelError::Setting {
        name: "effects",
        found: "steps that are refused".to_string(),
        expected: "effects of time beside a model of all six columns or of one, finite in its range",
    }
}

impl Elastic<f64> for Model {
    fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        if let Model::Energy(model) = self {
            return model.wrench_and_stiffness(pose);
        }
        let nothing = (Wrench::from_array(&[f64::NAN; 6]), [[f64::NAN; 6]; 6]);
        let Ok((h, k)) = self.value_and_jacobian(&pose.to_array()) else {
            return nothing;
        };
        let (Ok(h), Ok(k)) = (Vec6::try_from(h), <[f64; 36]>::try_from(k)) else {
            return nothing;
        };
        let tangent = core::array::from_fn(|i| core::array::from_fn(|j| k[6 * i + j]));
        (Wrench::from_array(&h), tangent)
    }
}

/// A map of one coordinate as the first of six, so that no stepper is needed for a line: where θ = 0
/// the mid frame turns nothing, and the other five stay zero.
struct FirstOfSix<'a>(&'a Model);

impl Elastic<f64> for FirstOfSix<'_> {
    fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        let (mut wrench, mut stiffness) = ([0.0; 6], [[0.0; 6]; 6]);
        let found = self.0.value_and_jacobian(&pose.to_array()[..1]);
        let (value, slope) = found.map_or((f64::NAN, f64::NAN), |(h, k)| (h[0], k[0]));
        (wrench[0], stiffness[0][0]) = (value, slope);
        (Wrench::from_array(&wrench), stiffness)
    }
}
