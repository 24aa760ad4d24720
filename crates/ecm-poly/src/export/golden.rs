//! Points at which an export is checked, spread over the range of the model.

use std::vec::Vec;

use ecm_se3::half_rotation;
use ecm_se3::linear::apply;

use crate::error::ModelError;
use crate::export::Precision;
use crate::export::model::Model;
use crate::export::reach::Reach;

/// Inputs and the predictions of the model there.
pub struct Golden {
    /// (count, n).
    pub points: Vec<Vec<f64>>,
    /// (count, m).
    pub values: Vec<Vec<f64>>,
    /// (count, m n).
    pub jacobians: Vec<Vec<f64>>,
    /// Largest difference due to rounding, of values and of Jacobians.
    pub tolerance: [f64; 2],
}

const COUNT: usize = 16;

impl Golden {
    /// Sixteen points; the first is the centre of the range or the rest pose.
    pub fn new(model: &Model, precision: Precision) -> Result<Self, ModelError> {
        Self::within(model, None, precision)
    }

    /// The same inside a reach; the first is its centre.
    pub fn within(
        model: &Model,
        reach: Option<&Reach>,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let mut golden = Golden {
            points: Vec::new(),
            values: Vec::new(),
            jacobians: Vec::new(),
            tolerance: [0.0; 2],
        };
        for i in 0..COUNT {
            let mut point = match reach {
                Some(reach) => point_in(model, reach, i),
                None => point(model, i),
            };
            if precision == Precision::Single {
                point.iter_mut().for_each(|x| *x = f64::from(*x as f32));
            }
            let (value, jacobian) = model.value_and_jacobian(&point)?;
            let largest = |v: &[f64]| v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            golden.tolerance[0] = golden.tolerance[0].max(largest(&value));
            golden.tolerance[1] = golden.tolerance[1].max(largest(&jacobian));
            golden.points.push(point);
            golden.values.push(value);
            golden.jacobians.push(jacobian);
        }
        let share = match precision {
            Precision::Single => 3e-4,
            Precision::Double => 1e-11,
        };
        golden.tolerance = golden.tolerance.map(|size| size.max(1e-12) * share);
        Ok(golden)
    }
}

/// Additive recurrence with irrational steps: evenly spread, and the same on every machine.
pub fn wave(i: usize, k: usize) -> f64 {
    const STEPS: [f64; 6] = [
        0.414_213, 0.732_050, 0.236_067, 0.645_751, 0.316_624, 0.605_551,
    ];
    let step = STEPS[k % 6] + 0.017 * (k / 6) as f64;
    2.0 * ((i as f64 * step).fract() - 0.5) * if i == 0 { 0.0 } else { 1.0 }
}

/// Point i inside a reach.
fn point_in(model: &Model, reach: &Reach, i: usize) -> Vec<f64> {
    let at = reach.point(|k| wave(i, k));
    match model {
        Model::Polynomial(_) => at,
        Model::Energy(model) => {
            let theta = [at[3], at[4], at[5]];
            let c = [at[0] + model.length_m(), at[1], at[2]];
            let r = apply(&half_rotation(&theta), &c);
            std::vec![r[0], r[1], r[2], theta[0], theta[1], theta[2]]
        }
    }
}

/// Point i.
fn point(model: &Model, i: usize) -> Vec<f64> {
    match model {
        Model::Polynomial(model) => (0..model.inputs())
            .map(|k| {
                let (lower, upper) = (model.lower()[k], model.upper()[k]);
                0.5 * (lower + upper) + 0.5 * (upper - lower) * wave(i, k)
            })
            .collect(),
        Model::Energy(model) => {
            // Inside the ball |c| < l, |θ| < α of the training data; never beyond π.
            let [length, angle] = model.scale();
            let part = |k: usize, size: f64| wave(i, k) * size / 3.0_f64.sqrt();
            let angle = angle.min(3.0);
            let theta = [part(3, angle), part(4, angle), part(5, angle)];
            let c = [
                model.length_m() + part(0, length),
                part(1, length),
                part(2, length),
            ];
            let r = apply(&half_rotation(&theta), &c);
            std::vec![r[0], r[1], r[2], theta[0], theta[1], theta[2]]
        }
    }
}
