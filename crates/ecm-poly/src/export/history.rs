//! A history of steps at which an export with effects of time is checked.

use std::string::ToString;
use std::vec::Vec;

use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::error::ModelError;
use crate::export::Precision;
use crate::export::golden::{Golden, wave};
use crate::export::model::Model;
use crate::export::reach::Reach;
use crate::stepper::line::LineState;
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

type Said = Option<(Vec<f64>, Vec<f64>)>;

impl History {
    /// The history of a model of six pose and six wrench columns, or of one and one.
    pub fn new(
        model: &Model,
        reach: Option<&Reach>,
        effects: &Effects<f64>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let points = Golden::within(model, reach, precision)?.points;
        let first = points.first().map_or(&[][..], Vec::as_slice);
        if model.shape() == (1, 1) {
            let at = |point: &[f64]| {
                let (value, slope) = model.value_and_jacobian(point).ok()?;
                Some((*point.first()?, *value.first()?, *slope.first()?))
            };
            let (point, value, _) = at(first).ok_or_else(refused)?;
            let mut state = LineState::new(point, value);
            return Self::along(&points, effects, precision, |point, dt, inputs| {
                let (point, value, slope) = at(point)?;
                let (h, k) = state.step(effects, point, (value, slope), dt, inputs)?;
                Some((std::vec![h], std::vec![k]))
            });
        }
        let stepper = Stepper {
            model,
            effects: *effects,
        };
        let pose = |point: &[f64]| Pose::checked(&Vec6::try_from(point).ok()?);
        let start = pose(first).and_then(|pose| stepper.init(&pose));
        let mut state = start.ok_or_else(refused)?;
        Self::along(&points, effects, precision, |point, dt, inputs| {
            let (h, k) = stepper.step(&mut state, &pose(point)?, dt, inputs)?;
            Some((h.to_array().to_vec(), k.as_flattened().to_vec()))
        })
    }

    /// Each point twice: after the move a rest.
    fn along(
        points: &[Vec<f64>],
        effects: &Effects<f64>,
        precision: Precision,
        mut step: impl FnMut(&[f64], f64, &Inputs<f64>) -> Said,
    ) -> Result<Self, ModelError> {
        let rounded = |x: f64| precision.rounded(x);
        let (mut steps, mut largest) = (Vec::new(), [0.0_f64; 2]);
        for i in 0..2 * points.len() {
            let pose = points[i / 2].clone();
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
            let (wrench, tangent) = step(&pose, dt, &told).ok_or_else(refused)?;
            for (size, values) in largest.iter_mut().zip([&wrench, &tangent]) {
                *size = values.iter().fold(*size, |m, x| m.max(x.abs()));
            }
            steps.push(Step {
                pose,
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
