//! Energies of pose and actuation: a sum of products of inputs, each times an energy of the pose.

use alloc::format;
use alloc::vec::Vec;

#[cfg(feature = "std")]
use ecm_se3::Real;
use ecm_se3::Vec6;
use ecm_se3::stiffness::StiffnessKind;

#[cfg(feature = "std")]
use crate::energy::expansion::{Expansion, first_order, power, row_orders, unscaled};
use crate::energy::invariants::Symmetry;
use crate::energy::model::EnergyModel;
#[cfg(feature = "std")]
use crate::energy::terms::terms;
use crate::error::{ModelError, check_count};

/// Π(p, a) = Σ s^k U_k(p), s the inputs over their scales.
#[derive(Clone, Debug)]
pub struct ActuatedModel {
    input_scale: Vec<f64>,
    /// Powers of the inputs, and the energy beside them, without symmetry.
    parts: Vec<(Vec<u8>, EnergyModel)>,
}

/// Most inputs beside the pose.
pub const MOST_ACTUATORS: usize = 10;
/// Exponents of the six mid-frame coordinates, and of the inputs.
#[cfg(feature = "std")]
type Wide = [u8; 6 + MOST_ACTUATORS];

impl ActuatedModel {
    /// From the length (m) and the degree, the length (m) and angle (rad) that make coordinates
    /// dimensionless, the scales of the inputs, and the powers and coefficients (J) of each part.
    ///
    /// # Errors
    /// No part, lists that do not fit together, or what [`EnergyModel::from_coefficients`] refuses.
    pub fn new(
        length_m: f64,
        degree: usize,
        scale: [f64; 2],
        input_scale: &[f64],
        parts: &[(Vec<u8>, Vec<f64>)],
    ) -> Result<Self, ModelError> {
        let sound = |x: &f64| x.is_finite() && *x > 0.0;
        let count = 1..=MOST_ACTUATORS;
        if !count.contains(&input_scale.len()) || !input_scale.iter().all(sound) || parts.is_empty()
        {
            return Err(ModelError::Setting {
                name: "parts",
                found: format!("{} of {} inputs", parts.len(), input_scale.len()),
                expected: "at least one part, and the positive scales of 1 to 10 inputs",
            });
        }
        let energy = |(powers, coefficients): &(Vec<u8>, Vec<f64>)| {
            check_count("powers", "numbers", powers.len(), input_scale.len())?;
            let (general, length) = (Symmetry::General, length_m);
            EnergyModel::from_coefficients(length, degree, general, scale, coefficients)
                .map(|energy| (powers.clone(), energy))
        };
        Ok(Self {
            parts: parts.iter().map(energy).collect::<Result<_, _>>()?,
            input_scale: input_scale.to_vec(),
        })
    }

    /// Number of inputs beside the pose.
    pub fn actuators(&self) -> usize {
        self.input_scale.len()
    }

    /// Undeformed length (m).
    pub fn length_m(&self) -> f64 {
        self.parts[0].1.length_m()
    }

    /// Length (m) and angle (rad) that make the coordinates dimensionless.
    pub fn scale(&self) -> [f64; 2] {
        self.parts[0].1.scale()
    }

    /// Scale of each input.
    pub fn input_scale(&self) -> &[f64] {
        &self.input_scale
    }

    /// h (6) and [K | G] (6, 6 + m), row by row, at a row of pose and inputs.
    ///
    /// # Errors
    /// Another number of values, a number that is not finite, a rotation beyond π.
    pub fn value_and_jacobian(&self, row: &[f64]) -> Result<(Vec<f64>, Vec<f64>), ModelError> {
        let n = 6 + self.actuators();
        check_count("a row", "numbers", row.len(), n)?;
        let pose: Vec6<f64> = core::array::from_fn(|i| row[i]);
        let (mut h, mut jacobian) = (alloc::vec![0.0; 6], alloc::vec![0.0; 6 * n]);
        for (powers, energy) in &self.parts {
            let wrench = energy.predict(&[pose])?[0];
            let stiffness = energy.stiffness(&[pose], StiffnessKind::Partial)?[0];
            let own = self.product(powers, &row[6..]);
            for i in 0..6 {
                h[i] += own * wrench[i];
                for j in 0..6 {
                    jacobian[n * i + j] += own * stiffness[i][j];
                }
            }
            for l in (0..self.actuators()).filter(|&l| powers[l] > 0) {
                let slope = self.product(&lowered(powers, l), &row[6..]) * f64::from(powers[l])
                    / self.input_scale[l];
                (0..6).for_each(|i| jacobian[n * i + 6 + l] += slope * wrench[i]);
            }
        }
        Ok((h, jacobian))
    }

    fn product(&self, powers: &[u8], inputs: &[f64]) -> f64 {
        let each = powers.iter().zip(inputs.iter().zip(&self.input_scale));
        each.flat_map(|(&e, (a, scale))| (0..e).map(move |_| a / scale))
            .product()
    }

    /// The sums of a controller: those of an energy of the pose, then for each input the six slopes of
    /// dΠ/da along the mid-frame coordinates.
    ///
    /// # Errors
    /// More monomials or entries than 16 bits count.
    #[cfg(feature = "std")]
    pub(crate) fn expansion<R: Real>(&self) -> Result<Expansion<R>, ModelError> {
        let first = &self.parts[0].1;
        let all = terms(Symmetry::General, first.degree())?;
        let mut weighted: Vec<(Wide, f64)> = Vec::new();
        for (powers, energy) in &self.parts {
            let scales = powers.iter().zip(&self.input_scale);
            let scale: f64 = scales.map(|(&e, &s)| power(s, e)).product();
            for (row, &c) in all.iter().zip(energy.coefficients()) {
                let mut exponents = [0; 6 + MOST_ACTUATORS];
                exponents[..6].copy_from_slice(row);
                exponents[6..6 + powers.len()].copy_from_slice(powers);
                if c != 0.0 {
                    let unit = unscaled(Symmetry::General, row, first.scale());
                    weighted.push((exponents, c * unit / scale));
                }
            }
        }
        let mut orders: Vec<Wide> = row_orders();
        for l in 6..6 + self.actuators() {
            for i in 0..6 {
                let mut order: Wide = first_order(i);
                order[l] += 1;
                orders.push(order);
            }
        }
        let found = Expansion::new(&weighted, &orders);
        let most = found.columns.len().max(found.products.len());
        if most > usize::from(u16::MAX) {
            return Err(ModelError::Setting {
                name: "model",
                found: format!("{most} terms of its derivatives"),
                expected: "at most 65535: take a lower degree",
            });
        }
        Ok(found)
    }
}

/// The powers with one factor of an input less.
fn lowered(powers: &[u8], input: usize) -> Vec<u8> {
    let mut lower = powers.to_vec();
    lower[input] = lower[input].saturating_sub(1);
    lower
}
