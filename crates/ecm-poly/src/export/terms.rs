//! The terms of a polynomial as products of earlier terms, for C and Rust alike.

use std::format;
use std::string::String;
use std::vec::Vec;

use ecm_se3::Real;

use crate::error::ModelError;
use crate::export::Precision;
use crate::export::model::Model;
use crate::normalise::unit_slope;
use crate::polynomial_model::PolynomialModel;

/// How every term and every derivative is one product.
pub struct Terms {
    /// Term t > 0 is term `.0` times input `.1`; the entry of the constant is never read.
    pub parents: Vec<(usize, usize)>,
    /// d(term `.0`)/d(input `.1`) is term `.2` times `.3`; never empty.
    pub slopes: Vec<(usize, usize, usize, f64)>,
}

impl Terms {
    /// # Errors
    /// More terms than 16 bits, or inputs than 8 bits count.
    pub fn new(model: &PolynomialModel) -> Result<Self, ModelError> {
        let n = model.inputs();
        let rows: Vec<&[u8]> = model.exponents().chunks_exact(n).collect();
        if rows.len() > usize::from(u16::MAX) || n > 255 {
            return Err(ModelError::Setting {
                name: "model",
                found: format!("{} terms", rows.len()),
                expected: "at most 65535 terms: take a lower degree",
            });
        }
        let lowered = |t: usize, i: usize| {
            let mut lower = rows[t].to_vec();
            lower[i] -= 1;
            rows.iter().position(|row| *row == lower).unwrap_or(0)
        };
        let last = |t: usize| rows[t].iter().rposition(|&e| e > 0);
        let parents = (0..rows.len())
            .map(|t| last(t).map_or((0, 0), |i| (lowered(t, i), i)))
            .collect();
        let slope = |i: usize| unit_slope(model.lower()[i], model.upper()[i]);
        let mut slopes: Vec<(usize, usize, usize, f64)> = (0..rows.len())
            .flat_map(|t| (0..n).map(move |i| (t, i)))
            .filter(|&(t, i)| rows[t][i] > 0)
            .map(|(t, i)| (t, i, lowered(t, i), f64::from(rows[t][i]) * slope(i)))
            .collect();
        if slopes.is_empty() {
            // C has no arrays of length 0: a constant has one slope of factor 0.
            slopes.push((0, 0, 0, 0.0));
        }
        Ok(Self { parents, slopes })
    }
}

/// 1 for each input that is a component of the rotation vector, else 0, with commas between.
pub fn turns(inputs: &str) -> String {
    let is_turn = |name: &str| name.starts_with("theta_") && name.ends_with("_rad");
    let each = inputs.split(", ").map(|name| u8::from(is_turn(name)));
    each.map(|turn| format!("{turn}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Largest step of each coordinate of the pose when a free pose is sought: what the model may mean.
/// None of a model without actuators behind the six columns of the pose.
pub fn most_step(model: &Model, inputs: &str, outputs: &str) -> Option<Vec<f64>> {
    const POSE: &str = "x_m, y_m, z_m, theta_x_rad, theta_y_rad, theta_z_rad, ";
    const WRENCH: &str = "fx_N, fy_N, fz_N, tau_x_Nm, tau_y_Nm, tau_z_Nm";
    if !inputs.starts_with(POSE) || outputs != WRENCH {
        return None;
    }
    match model {
        Model::Polynomial(model) => {
            let ends = model.lower().iter().zip(model.upper());
            Some(
                ends.take(6)
                    .map(|(low, high)| (high - low).max(1e-9))
                    .collect(),
            )
        }
        Model::Energy(_) => None,
        Model::Actuated(model) => {
            let length = 0.3 * model.length_m();
            Some([[length; 3], [0.3; 3]].as_flattened().to_vec())
        }
    }
}

/// 1 / k!
pub fn inverse_factorial(k: u32) -> f64 {
    1.0 / (1..=k).map(f64::from).product::<f64>()
}

/// The limit of [`ecm_se3::Pose::checked`] on |theta|^2.
pub fn half_turn_squared(precision: Precision) -> String {
    fn limit<R: Real>() -> String {
        let most = R::PI * R::PI * (R::ONE + R::from_u16(8) * R::EPSILON);
        format!("{:e}", most.to_f64())
    }
    match precision {
        Precision::Single => limit::<f32>(),
        Precision::Double => limit::<f64>(),
    }
}
