//! Outlines of the built-in solids of revolution.

use crate::FemError;
use std::f64::consts::PI;

/// Thinnest wall, and narrowest or widest waist, over the radius: elements follow thinner ones too,
/// but nobody has compared their stiffness with a finer mesh.
const THINNEST: f64 = 0.01;

/// Least radius over the length: below it elements count as flat.
const SLENDEREST: f64 = 2e-5;

/// Largest radius over the length.
const FLATTEST: f64 = 1e3;

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

    /// Radius at both ends, and where the outline is narrowest or widest.
    fn radii_m(&self) -> [f64; 2] {
        match *self {
            Self::Cylinder { radius_m } | Self::Tube { radius_m, .. } => [radius_m; 2],
            Self::Hourglass {
                radius_m,
                waist_radius_m,
            }
            | Self::StackedDiscs {
                radius_m,
                waist_radius_m,
                ..
            } => [radius_m, waist_radius_m],
        }
    }

    pub(super) fn outer_m(&self, x_over_l: f64) -> f64 {
        let [radius_m, waist_radius_m] = self.radii_m();
        let wave = match self {
            Self::StackedDiscs { discs, .. } => (PI * turns(*discs) * x_over_l).cos(),
            _ => 2.0 * x_over_l - 1.0,
        };
        waist_radius_m + (radius_m - waist_radius_m) * wave * wave
    }

    /// Longest layer at `x_over_l`, over the length, that the outline's curvature allows.
    ///
    /// A waist: 0.7 √(r / |r″|); from twice that on, elements can invert. The wall of a tube: half
    /// of √(radius × wall), over which a clamped edge bends it, growing with the distance from the
    /// nearest edge.
    pub(super) fn longest_layer(&self, x_over_l: f64, length_m: f64) -> f64 {
        let [radius_m, waist_radius_m] = self.radii_m();
        let bends = match self {
            Self::Tube { inner_radius_m, .. } => {
                let bends_over_m = (radius_m * (radius_m - inner_radius_m)).sqrt();
                return 0.5 * (bends_over_m / length_m + x_over_l.min(1.0 - x_over_l));
            }
            // That of crest and waist also between them, where it changes fastest.
            Self::StackedDiscs { discs, .. } => 2.0 * (PI * turns(*discs)).powi(2),
            _ => 8.0,
        };
        let curvature_m = bends * (radius_m - waist_radius_m).abs();
        0.7 * (self.outer_m(x_over_l) / curvature_m).sqrt()
    }

    /// Fewest points around that the curvature of a tube's wall needs: 1.1 √(radius × wall) apart.
    pub(super) fn fewest_around(&self) -> f64 {
        match self {
            Self::Tube {
                radius_m,
                inner_radius_m,
            } => 5.5 * (radius_m / (radius_m - inner_radius_m)).sqrt(),
            _ => 0.0,
        }
    }

    /// Refuses dimensions that no mesh can be made of, by their names.
    pub(super) fn check(&self, length_m: f64) -> Result<(), FemError> {
        let refused = |name, value, expected| {
            Err(FemError::Parameter {
                name,
                value,
                expected,
            })
        };
        let positive = |name, value: f64| {
            if (1e-100..=1e100).contains(&value) {
                return Ok(());
            }
            refused(name, value, "a positive length in metres (1e-100 to 1e100)")
        };
        let across = |name, value: f64| {
            positive(name, value)?;
            if value < SLENDEREST * length_m {
                return refused(name, value, "at least 2e-5 of length_m: that is a rod");
            }
            if value > FLATTEST * length_m {
                return refused(name, value, "at most 1000 times length_m");
            }
            Ok(())
        };
        positive("length_m", length_m)?;
        let [radius_m, waist_radius_m] = self.radii_m();
        across("radius_m", radius_m)?;
        across("waist_radius_m", waist_radius_m)?;
        if !(THINNEST..=1.0 / THINNEST).contains(&(waist_radius_m / radius_m)) {
            let expected = "1 % of radius_m or more, and at most 100 times as much";
            return refused("waist_radius_m", waist_radius_m, expected);
        }
        match *self {
            Self::Tube { inner_radius_m, .. } => {
                if !(inner_radius_m.is_finite() && inner_radius_m > 0.0) {
                    let expected = "a positive length in metres";
                    return refused("inner_radius_m", inner_radius_m, expected);
                }
                if inner_radius_m >= radius_m {
                    return refused("inner_radius_m", inner_radius_m, "less than radius_m");
                }
                let wall_m = radius_m - inner_radius_m;
                if wall_m < THINNEST * (1.0 - 1e-9) * radius_m || wall_m < 1e-5 * length_m {
                    let expected = "a wall of 1 % of radius_m or more, and of 1e-5 of length_m";
                    return refused("inner_radius_m", inner_radius_m, expected);
                }
                Ok(())
            }
            Self::StackedDiscs { discs, .. } if !(2..=40).contains(&discs) => {
                refused("disc_count", discs as f64, "2 to 40")
            }
            _ => Ok(()),
        }
    }
}

/// Half waves of stacked discs along the body.
fn turns(discs: usize) -> f64 {
    (discs.max(1) - 1) as f64
}
