//! A history of steps at which an export with effects of time is checked.

use std::string::ToString;
use std::vec::Vec;

use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::error::ModelError;
use crate::export::Precision;
use crate::export::golden::{Golden, wave};
use crate::export::model::{Model, Places};
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
    /// The history of a model whose columns lie at these places.
    pub fn new(
        model: (&Model, &Places),
        reach: Option<&Reach>,
        effects: &Effects<f64>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let points = Golden::within(model.0, reach, precision)?.points;
        let map = OfColumns(model.0, model.1);
        Self::along(&points, &map, effects, precision)
    }

    /// Each point twice: after the move a rest.
    fn along(
        points: &[Vec<f64>],
        model: &OfColumns<'_>,
        effects: &Effects<f64>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let stepper = Stepper {
            model,
            effects: *effects,
        };
        let places = model.1;
        let pose = |point: &[f64]| {
            let mut all = [0.0; 6];
            for (x, &place) in point.iter().zip(&places.inputs) {
                all[place] = *x;
            }
            Pose::checked(&all)
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
            let wrench = places.of_outputs(&h.to_array());
            let tangent = places.of_matrix(&k).concat();
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
        expected: "effects of time beside a model that is finite in its range",
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

/// A map whose columns lie at places among six, of which the others stay zero.
struct OfColumns<'a>(&'a Model, &'a Places);

impl Elastic<f64> for OfColumns<'_> {
    fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        let Self(model, places) = self;
        if model.shape() == (6, 6) {
            return model.wrench_and_stiffness(pose);
        }
        let (mut wrench, mut stiffness) = ([0.0; 6], [[0.0; 6]; 6]);
        match model.value_and_jacobian(&places.of_inputs(&pose.to_array())) {
            Ok((h, k)) => {
                let rows = k.chunks_exact(places.inputs.len());
                for ((&i, value), row) in places.outputs.iter().zip(h).zip(rows) {
                    wrench[i] = value;
                    for (&j, slope) in places.inputs.iter().zip(row) {
                        stiffness[i][j] = *slope;
                    }
                }
            }
            Err(_) => wrench = [f64::NAN; 6],
        }
        (Wrench::from_array(&wrench), stiffness)
    }
}
