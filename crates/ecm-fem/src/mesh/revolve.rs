//! Structured meshes of solids of revolution about x.
//!
//! A disc of hexagonal rings (or an annulus) is triangulated once, extruded into
//! prisms, and each prism is split into three tetrahedra whose diagonals start at
//! the smaller node number, so that neighbours agree. Rings and layers crowd
//! towards the two clamped rims, where the bonded, nearly incompressible solid is
//! singular: there a graded mesh has the error of a uniform one with three times
//! as many nodes. Edges on the lateral surface are curved.

use super::{Mesh, quadratic};
use crate::FemError;
use std::f64::consts::TAU;

/// How fine a structured mesh is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quality {
    /// Pose error below 1 % of the converged answer, about 1100 nodes: for batches.
    #[default]
    Standard,
    /// Pose error below 0.5 %.
    Fine,
    /// Numbers of rings and layers and how strongly they crowd to the rims.
    Custom {
        /// Rings of the disc, or layers through a tube's wall.
        rings: usize,
        /// Layers of prisms along x.
        layers: usize,
        /// Ratio of the middle to the smallest layer, in thousandths (1000: uniform).
        grading_per_mille: u32,
    },
}

impl std::str::FromStr for Quality {
    type Err = FemError;

    fn from_str(word: &str) -> Result<Self, FemError> {
        match word {
            "standard" => Ok(Self::Standard),
            "fine" => Ok(Self::Fine),
            _ => Err(FemError::Word {
                name: "quality",
                value: word.into(),
                expected: "\"standard\" or \"fine\"",
            }),
        }
    }
}

/// Outline of the solid.
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

impl Profile {
    fn inner_m(&self) -> f64 {
        match self {
            Self::Tube { inner_radius_m, .. } => *inner_radius_m,
            _ => 0.0,
        }
    }

    fn outer_m(&self, x_over_l: f64) -> f64 {
        match self {
            Self::Cylinder { radius_m } | Self::Tube { radius_m, .. } => *radius_m,
            Self::Hourglass { radius_m, waist_radius_m } => {
                waist_radius_m + (radius_m - waist_radius_m) * (2.0 * x_over_l - 1.0).powi(2)
            }
        }
    }

    fn check(&self, length_m: f64) -> Result<(), FemError> {
        let positive = |name, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(FemError::Parameter { name, value, expected: "a positive length in metres" })
            }
        };
        positive("length_m", length_m)?;
        match self {
            Self::Cylinder { radius_m } => positive("radius_m", *radius_m),
            Self::Tube { radius_m, inner_radius_m } => {
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
            Self::Hourglass { radius_m, waist_radius_m } => {
                positive("radius_m", *radius_m)?;
                positive("waist_radius_m", *waist_radius_m)
            }
        }
    }
}

/// A triangulated cross-section: (radius fraction 0..1 from inner to outer, angle).
struct Section {
    points: Vec<(f64, f64)>,
    triangles: Vec<[usize; 3]>,
    ring: Vec<usize>,
}

/// Points 0..=n on [0, 1] whose steps shrink geometrically towards 1.
fn crowd_to_one(n: usize, last_over_first: f64) -> Vec<f64> {
    let q = if n > 1 { last_over_first.powf(1.0 / (n as f64 - 1.0)) } else { 1.0 };
    let mut x = vec![0.0];
    let mut step = 1.0;
    for i in 0..n {
        x.push(x[i] + step);
        step *= q;
    }
    let end = x[n];
    x.iter().map(|v| v / end).collect()
}

/// Points 0..=n on [0, 1] crowded to both ends.
fn crowd_to_ends(n: usize, last_over_first: f64) -> Vec<f64> {
    // Steps fall geometrically with the distance from the middle step.
    let middle = (n as f64 - 1.0) / 2.0;
    let q = if n > 2 { last_over_first.powf(1.0 / middle) } else { 1.0 };
    let mut x = vec![0.0];
    for i in 0..n {
        x.push(x[i] + q.powf((i as f64 - middle).abs()));
    }
    let end = x[n];
    x.iter().map(|v| v / end).collect()
}

fn disc(rings: usize, grading: f64) -> Section {
    let radii = crowd_to_one(rings, grading);
    let mut section = Section { points: vec![(0.0, 0.0)], triangles: Vec::new(), ring: vec![0] };
    for k in 1..=rings {
        for j in 0..6 * k {
            section.points.push((radii[k], TAU * j as f64 / (6 * k) as f64));
            section.ring.push(k);
        }
    }
    // Ring k holds 6 k points and begins at 1 + 3 k (k − 1).
    let at = |k: usize, j: usize| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) + j % (6 * k) };
    for k in 1..=rings {
        for sector in 0..6 {
            for i in 0..k {
                let (inner, outer) = (sector * (k - 1) + i, sector * k + i);
                section.triangles.push([at(k - 1, inner), at(k, outer), at(k, outer + 1)]);
                if i + 1 < k {
                    section.triangles.push([at(k - 1, inner), at(k, outer + 1), at(k - 1, inner + 1)]);
                }
            }
        }
    }
    section
}

fn annulus(rings: usize, around: usize, grading: f64) -> Section {
    let radii = crowd_to_ends(rings, grading);
    let mut section = Section { points: Vec::new(), triangles: Vec::new(), ring: Vec::new() };
    for (k, &radius) in radii.iter().enumerate() {
        for j in 0..around {
            section.points.push((radius, TAU * j as f64 / around as f64));
            section.ring.push(k);
        }
    }
    for k in 0..rings {
        for j in 0..around {
            let next = (j + 1) % around;
            let (a, b) = (k * around + j, k * around + next);
            let (c, d) = (a + around, b + around);
            section.triangles.push([a, c, d]);
            section.triangles.push([a, d, b]);
        }
    }
    section
}

/// Splits a prism (bottom 0 1 2, top 3 4 5 above them) so that every quadrilateral
/// face is cut from its smallest node (Dompierre et al. 1999).
fn split(prism: [usize; 6]) -> [[usize; 4]; 3] {
    let bottom = [prism[0], prism[1], prism[2]];
    let turn = (0..3).min_by_key(|&i| bottom[i]).unwrap_or(0);
    let v = |i: usize| prism[(i % 3 + turn) % 3 + 3 * (i / 3)];
    if v(1).min(v(5)) < v(2).min(v(4)) {
        [[v(0), v(1), v(2), v(5)], [v(0), v(1), v(5), v(4)], [v(0), v(4), v(5), v(3)]]
    } else {
        [[v(0), v(1), v(2), v(4)], [v(0), v(4), v(2), v(5)], [v(0), v(4), v(5), v(3)]]
    }
}

/// Rings, layers, ratio of smallest to largest step.
fn sizes(profile: &Profile, length_m: f64, quality: Quality) -> (usize, usize, f64) {
    let slender = length_m / (2.0 * profile.outer_m(0.0));
    let (rings, per_diameter, grading) = match quality {
        Quality::Standard => (2, 5.1, 0.45),
        Quality::Fine => (3, 8.9, 0.2),
        Quality::Custom { rings, layers, grading_per_mille } => {
            return (rings.max(1), layers.max(1), 1e3 / f64::from(grading_per_mille.max(1)));
        }
    };
    let layers = ((per_diameter * slender).round() as usize).clamp(4, 60);
    match profile {
        Profile::Tube { .. } => (rings - 1, layers, grading),
        _ => (rings, layers, grading),
    }
}

/// The mesh of `profile` between x = 0 and x = `length_m`.
pub fn mesh(length_m: f64, profile: &Profile, quality: Quality) -> Result<Mesh, FemError> {
    profile.check(length_m)?;
    let (rings, layers, grading) = sizes(profile, length_m, quality);
    let hollow = profile.inner_m() > 0.0;
    let section = if hollow {
        annulus(rings, 6 * (rings + 1), grading)
    } else {
        disc(rings, grading)
    };
    let stations = crowd_to_ends(layers, grading);
    let radius_at = |fraction: f64, s: f64| {
        profile.inner_m() + fraction * (profile.outer_m(s) - profile.inner_m())
    };
    let per_layer = section.points.len();
    let mut nodes = Vec::new();
    for &s in &stations {
        for &(fraction, angle) in &section.points {
            let r = radius_at(fraction, s);
            nodes.push([length_m * s, r * angle.cos(), r * angle.sin()]);
        }
    }
    let mut corners = Vec::new();
    for layer in 0..layers {
        let (below, above) = (layer * per_layer, (layer + 1) * per_layer);
        for t in &section.triangles {
            corners.extend(split([
                below + t[0],
                below + t[1],
                below + t[2],
                above + t[0],
                above + t[1],
                above + t[2],
            ]));
        }
    }
    let outermost = section.ring.iter().copied().max().unwrap_or(0);
    let tets = quadratic::raise(&mut nodes, &corners, |a, b, x| {
        let mid = [0, 1, 2].map(|k| 0.5 * (x[a][k] + x[b][k]));
        let (ka, kb) = (section.ring[a % per_layer], section.ring[b % per_layer]);
        let on_outer = ka == outermost && kb == outermost;
        let on_inner = hollow && ka == 0 && kb == 0;
        if !on_outer && !on_inner {
            return mid;
        }
        let r = radius_at(if on_outer { 1.0 } else { 0.0 }, mid[0] / length_m);
        let scale = r / mid[1].hypot(mid[2]);
        [mid[0], mid[1] * scale, mid[2] * scale]
    });
    let at_end = |x: f64| -> Vec<usize> {
        (0..nodes.len()).filter(|&i| (nodes[i][0] - x).abs() < 1e-12 * length_m).collect()
    };
    let (base, top) = (at_end(0.0), at_end(length_m));
    Mesh::new(nodes, tets, base, top)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn volumes_come_close_to_the_solids() {
        let (l, r) = (0.1, 0.03);
        let cylinder = Mesh::cylinder(l, r, Quality::Standard).unwrap();
        assert!((cylinder.volume_m3() / (PI * r * r * l) - 1.0).abs() < 2e-3);
        let tube = Mesh::tube(l, r, 0.02, Quality::Standard).unwrap();
        assert!((tube.volume_m3() / (PI * (r * r - 4e-4) * l) - 1.0).abs() < 2e-3);
        // ∫ (w + d s²)² over s in (−1, 1), halved: w² + 2 w d / 3 + d² / 5.
        let (w, d) = (0.02, 0.01);
        let exact = PI * l * (w * w + 2.0 * w * d / 3.0 + d * d / 5.0);
        let hourglass = Mesh::hourglass(l, r, w, Quality::Standard).unwrap();
        assert!((hourglass.volume_m3() / exact - 1.0).abs() < 4e-3);
    }

    #[test]
    fn standard_neck_has_about_eleven_hundred_nodes() {
        let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard).unwrap();
        assert!((1000..1200).contains(&mesh.nodes_m().len()), "{}", mesh.nodes_m().len());
    }

    #[test]
    fn wrong_sizes_are_named() {
        let wrong = Mesh::tube(0.1, 0.03, 0.04, Quality::Standard).unwrap_err();
        assert!(wrong.to_string().contains("inner_radius_m is 0.04"));
        assert!(Mesh::cylinder(f64::NAN, 0.03, Quality::Standard).is_err());
    }
}
