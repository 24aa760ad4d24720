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
    /// Largest difference of values due to rounding.
    pub tolerance: f64,
    /// The same of each column of the Jacobians, (n,): of newtons by metre and by pascal.
    pub jacobian_tolerance: Vec<f64>,
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
            tolerance: 1e-12,
            jacobian_tolerance: std::vec![1e-300; model.shape().0],
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
            for x in &value {
                golden.tolerance = golden.tolerance.max(x.abs());
            }
            let n = point.len();
            for (j, x) in jacobian.iter().enumerate() {
                let most = &mut golden.jacobian_tolerance[j % n];
                *most = most.max(x.abs());
            }
            // Columns of the pose round alike; those of actuators have sizes of their own.
            let shared = &mut golden.jacobian_tolerance[..n.min(6)];
            let most = shared.iter().fold(1e-12, |most: f64, x| most.max(*x));
            shared.fill(most);
            golden.points.push(point);
            golden.values.push(value);
            golden.jacobians.push(jacobian);
        }
        let share = match precision {
            Precision::Single => 3e-4,
            Precision::Double => 1e-11,
        };
        golden.tolerance *= share;
        golden
            .jacobian_tolerance
            .iter_mut()
            .for_each(|size| *size *= share);
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
        Model::Energy(model) => in_base(at, model.length_m()),
        Model::Actuated(model) => in_base(at, model.length_m()),
    }
}

/// A row of mid-frame coordinates and what stands behind them as one of a pose.
fn in_base(mut row: Vec<f64>, length_m: f64) -> Vec<f64> {
    let r = apply(
        &half_rotation(&[row[3], row[4], row[5]]),
        &[row[0] + length_m, row[1], row[2]],
    );
    row[..3].copy_from_slice(&r);
    row
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
        Model::Energy(model) => ball(i, model.scale(), model.length_m()),
        Model::Actuated(model) => {
            let mut row = ball(i, model.scale(), model.length_m());
            let inputs = model.input_scale().iter().enumerate();
            row.extend(inputs.map(|(k, scale)| 0.5 * scale * (1.0 + wave(i, 6 + k))));
            row
        }
    }
}

/// Pose i inside the ball |c| < l, |θ| < α of the training data; never beyond π.
fn ball(i: usize, [length, angle]: [f64; 2], length_m: f64) -> Vec<f64> {
    let part = |k: usize, size: f64| wave(i, k) * size / 3.0_f64.sqrt();
    let size = |k: usize| if k < 3 { length } else { angle.min(3.0) };
    in_base((0..6).map(|k| part(k, size(k))).collect(), length_m)
}
