//! Outlines of the built-in solids of revolution.

use crate::FemError;
use std::f64::consts::{PI, TAU};

/// Outline of the solid.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Profile {
    /// r(x) = radius.
    Cylinder {
        /// Radius.
        radius_m: f64,
    },
    /// Cylinder with a coaxial hole.
    Tube {
        /// Outer radius.
        radius_m: f64,
        /// Radius of the hole.
        inner_radius_m: f64,
    },
    /// r(x) = waist + (radius − waist)(2x/L − 1)².
    Hourglass {
        /// Radius at both ends.
        radius_m: f64,
        /// Radius at half length.
        waist_radius_m: f64,
    },
    /// Discs with rounded waists: r(x) = waist + (radius − waist) cos²(π (discs − 1) x / L).
    StackedDiscs {
        /// Radius of the discs.
        radius_m: f64,
        /// Radius between them.
        waist_radius_m: f64,
        /// Number of discs, the halves at both ends included.
        discs: usize,
    },
}

impl Profile {
    pub(super) fn inner_m(&self) -> f64 {
        match self {
            Self::Tube { inner_radius_m, .. } => *inner_radius_m,
            _ => 0.0,
        }
    }

    pub(super) fn outer_m(&self, x_over_l: f64) -> f64 {
        match self {
            Self::Cylinder { radius_m } | Self::Tube { radius_m, .. } => *radius_m,
            Self::Hourglass {
                radius_m,
                waist_radius_m,
            } => waist_radius_m + (radius_m - waist_radius_m) * (2.0 * x_over_l - 1.0).powi(2),
            Self::StackedDiscs {
                radius_m,
                waist_radius_m,
                discs,
            } => {
                let turns = (discs.max(&1) - 1) as f64;
                let wave = (0.5 * TAU * turns * x_over_l).cos();
                waist_radius_m + (radius_m - waist_radius_m) * wave * wave
            }
        }
    }

    /// Longest layer over the length whose elements follow the outline: √(c r / |r″|).
    pub(super) fn longest_layer(&self, x_over_l: f64) -> f64 {
        let curvature_m = match self {
            Self::Cylinder { .. } | Self::Tube { .. } => 0.0,
            Self::Hourglass {
                radius_m,
                waist_radius_m,
            } => 8.0 * (radius_m - waist_radius_m),
            Self::StackedDiscs {
                radius_m,
                waist_radius_m,
                discs,
            } => {
                let turns = (discs.max(&1) - 1) as f64;
                let wave = (TAU * turns * x_over_l).cos();
                2.0 * (PI * turns).powi(2) * (radius_m - waist_radius_m) * wave
            }
        };
        let c: f64 = std::env::var("ECM_C")
            .ok()
            .and_then(|v| v.parse().ok())
            .unwrap_or(0.5);
        (c * self.outer_m(x_over_l) / curvature_m.abs()).sqrt()
    }

    /// Points around a tube of which `for_thick` are enough for a thick wall: their distance over
    /// √(radius × wall), the length over which a curved wall bends, is that of the thinnest tube
    /// which `for_thick` serve.
    pub(super) fn points_around(&self, for_thick: usize) -> usize {
        let Self::Tube {
            radius_m,
            inner_radius_m,
        } = self
        else {
            return for_thick;
        };
        let c: f64 = std::env::var("ECM_A")
            .ok()
            .and_then(|v| v.parse().ok())
            .unwrap_or(5.5);
        let slender_wall = radius_m / (radius_m - inner_radius_m);
        (c * slender_wall.sqrt() * if for_thick > 10 { 1.6 } else { 1.0 }).ceil() as usize
    }

    pub(super) fn check(&self, length_m: f64) -> Result<(), FemError> {
        let positive = |name, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(FemError::Parameter {
                    name,
                    value,
                    expected: "a positive length in metres",
                })
            }
        };
        positive("length_m", length_m)?;
        match self {
            Self::Cylinder { radius_m } => positive("radius_m", *radius_m),
            Self::Tube {
                radius_m,
                inner_radius_m,
            } => {
                positive("radius_m", *radius_m)?;
                positive("inner_radius_m", *inner_radius_m)?;
                if inner_radius_m < radius_m {
                    return Ok(());
                }
                Err(FemError::Parameter {
                    name: "inner_radius_m",
                    value: *inner_radius_m,
                    expected: "less than radius_m",
                })
            }
            Self::Hourglass {
                radius_m,
                waist_radius_m,
            } => {
                positive("radius_m", *radius_m)?;
                positive("waist_radius_m", *waist_radius_m)
            }
            Self::StackedDiscs {
                radius_m,
                waist_radius_m,
                discs,
            } => {
                positive("radius_m", *radius_m)?;
                positive("waist_radius_m", *waist_radius_m)?;
                if (2..=40).contains(discs) {
                    return Ok(());
                }
                Err(FemError::Parameter {
                    name: "disc_count",
                    value: *discs as f64,
                    expected: "2 to 40",
                })
            }
        }
    }
}
