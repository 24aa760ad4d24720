//! Settings of the nonlinear solver and their ranges.

use crate::FemError;
use crate::body::Formulation;
use crate::element::Rule;

/// Settings of the nonlinear solver.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Residual over the force unit μ V / L at which a state counts as equilibrium (1e-9; 1e-14 to
    /// 1e-3).
    pub tolerance: f64,
    /// Newton iterations per load step (14; 1 to 1000).
    pub iterations: usize,
    /// Largest platform rotation (rad) or translation (over L) of one Newton step (0.5; 0.001 to 3).
    pub step_limit: f64,
    /// Smallest load step as a share of the way (1/32; 1e-4 to 1).
    pub smallest_load_step: f64,
    /// Quadrature ([`Rule::Degree2`]).
    pub rule: Rule,
    /// Treatment of the pressure ([`Formulation::TaylorHood`]).
    pub formulation: Formulation,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: 1e-9,
            iterations: 14,
            step_limit: 0.5,
            smallest_load_step: 1.0 / 32.0,
            rule: Rule::Degree2,
            formulation: Formulation::TaylorHood,
        }
    }
}

impl Settings {
    /// Checks every number.
    ///
    /// # Errors
    /// The first setting out of its range, with the range.
    ///
    /// ```
    /// use ecm_fem::Settings;
    /// assert!(Settings::default().validate().is_ok());
    /// let wrong = Settings { tolerance: f64::NAN, ..Settings::default() };
    /// assert!(wrong.validate().unwrap_err().to_string().contains("tolerance is NaN"));
    /// ```
    pub fn validate(&self) -> Result<(), FemError> {
        let iterations = self.iterations as f64;
        for (name, value, range, expected) in [
            ("tolerance", self.tolerance, 1e-14..=1e-3, "1e-14 to 1e-3"),
            ("iterations", iterations, 1.0..=1000.0, "1 to 1000"),
            ("step_limit", self.step_limit, 1e-3..=3.0, "0.001 to 3"),
            (
                "smallest_load_step",
                self.smallest_load_step,
                1e-4..=1.0,
                "1e-4 to 1",
            ),
        ] {
            if !range.contains(&value) {
                return Err(FemError::Parameter {
                    name,
                    value,
                    expected,
                });
            }
        }
        Ok(())
    }
}
