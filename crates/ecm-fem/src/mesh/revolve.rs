//! Structured meshes of solids of revolution about x.
//!
//! A disc (or annulus) of rings of points is triangulated once, extruded into
//! prisms, and each prism is split into three tetrahedra by a rank of the vertices,
//! so that neighbours agree. Rings and layers are finer
//! towards the two clamped rims, where the bonded, nearly incompressible solid is
//! singular: there a graded mesh has the error of a uniform one with three times
//! as many nodes. Edges on the lateral surface are curved.
//!
//! Edges within the body are straight. Where a curved edge would then cut through the element
//! behind it (the hole of a thin tube, a waist), they follow the outline as well, and layers and
//! points around become as fine as the outline's curvature needs.

use super::{Mesh, profile::Profile, quadratic};
use crate::FemError;
use std::f64::consts::TAU;

/// Fineness of a structured mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Quality {
    /// Pose error below 1 % of the converged solution, about 1200 nodes: for batches.
    #[default]
    Standard,
    /// Pose error below 0.5 %.
    Fine,
    /// Numbers of rings and layers, and their grading towards the rims.
    Custom {
        /// Rings of the disc, or layers through a tube's wall.
        rings: usize,
        /// Layers of prisms along x.
        layers: usize,
        /// Points around the rim; 0: six per ring, growing outwards.
        around: usize,
        /// Ratio of the smallest to the largest layer, in thousandths (1000: uniform).
        layer_grading_per_mille: u32,
        /// The same for the rings.
        ring_grading_per_mille: u32,
    },
}

impl Quality {
    /// [`Self::Custom`] by numbers of rings, layers and points around, and both gradings.
    pub const fn custom(
        [rings, layers, around]: [usize; 3],
        [layer_grading_per_mille, ring_grading_per_mille]: [u32; 2],
    ) -> Self {
        Self::Custom {
            rings,
            layers,
            around,
            layer_grading_per_mille,
            ring_grading_per_mille,
        }
    }
}

impl std::str::FromStr for Quality {
    type Err = FemError;

    fn from_str(word: &str) -> Result<Self, FemError> {
        match word {
            "standard" => Ok(Self::Standard),
            "fine" => Ok(Self::Fine),
            // rings x layers x around, graded as the standard mesh: for studies of convergence.
            _ if word.split('x').count() == 3 && word.split('x').all(counts) => {
                let n: Vec<usize> = word.split('x').filter_map(|v| v.parse().ok()).collect();
                Ok(Self::custom([n[0], n[1], n[2]], [250, 200]))
            }
            _ => Err(FemError::Word {
                name: "quality",
                value: word.into(),
                expected: "\"standard\" or \"fine\"",
            }),
        }
    }
}

/// Most rings, layers and points around.
const MOST: usize = 200;

/// Most prisms, three tetrahedra each: some 10⁶ nodes, far more than can be factorised.
const MOST_PRISMS: usize = 200_000;

fn counts(word: &str) -> bool {
    matches!(word.parse(), Ok(1..=MOST))
}

impl Quality {
    pub(super) fn check(self) -> Result<(), FemError> {
        let Self::Custom {
            rings,
            layers,
            around,
            ..
        } = self
        else {
            return Ok(());
        };
        for (name, value) in [
            ("rings", rings),
            ("layers", layers),
            ("points around", around),
        ] {
            if value > MOST || (name == "points around" && (1..3).contains(&value)) {
                return Err(FemError::Parameter {
                    name,
                    value: value as f64,
                    expected: "at most 200, and at least 3 points around",
                });
            }
        }
        Ok(())
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
    let q = if n > 1 {
        last_over_first.powf(1.0 / (n as f64 - 1.0))
    } else {
        1.0
    };
    let mut x = vec![0.0];
    let mut step = 1.0;
    for i in 0..n {
        x.push(x[i] + step);
        step *= q;
    }
    let end = x[n];
    x.iter().map(|v| v / end).collect()
}

/// Points 0..=n on [0, 1], finer towards both ends.
pub(super) fn crowd_to_ends(n: usize, last_over_first: f64) -> Vec<f64> {
    // Steps fall geometrically with the distance from the middle step.
    let middle = (n as f64 - 1.0) / 2.0;
    let q = if n > 2 {
        last_over_first.powf(1.0 / middle)
    } else {
        1.0
    };
    let mut x = vec![0.0];
    for i in 0..n {
        x.push(x[i] + q.powf((i as f64 - middle).abs()));
    }
    let end = x[n];
    x.iter().map(|v| v / end).collect()
}

/// Rings of points on the unit disc or annulus with `counts[k]` points at `radii[k]`.
fn rings_of(radii: &[f64], counts: &[usize]) -> Section {
    let mut section = Section {
        points: Vec::new(),
        triangles: Vec::new(),
        ring: Vec::new(),
    };
    let mut start = Vec::new();
    for (k, (&radius, &count)) in radii.iter().zip(counts).enumerate() {
        start.push(section.points.len());
        for j in 0..count {
            section.points.push((radius, TAU * j as f64 / count as f64));
            section.ring.push(k);
        }
    }
    for k in 1..counts.len() {
        let (inner, outer) = (counts[k - 1], counts[k]);
        let at_inner = |i: usize| start[k - 1] + i % inner;
        let at_outer = |j: usize| start[k] + j % outer;
        let (mut i, mut j) = (0, 0);
        // A single centre point is one end of every triangle.
        let steps_inner = if inner == 1 { 0 } else { inner };
        while i < steps_inner || j < outer {
            // Advance on the ring whose next point comes first.
            if j < outer && (i == steps_inner || (j + 1) * inner <= (i + 1) * outer) {
                section
                    .triangles
                    .push([at_inner(i), at_outer(j), at_outer(j + 1)]);
                j += 1;
            } else {
                section
                    .triangles
                    .push([at_inner(i), at_outer(j), at_inner(i + 1)]);
                i += 1;
            }
        }
    }
    section
}

/// Splits a prism (bottom 0 1 2, top 3 4 5 above them) into three tetrahedra, cutting
/// every quadrilateral face from its vertex of lowest rank (Dompierre et al. 1999).
fn split(prism: [usize; 6], rank: impl Fn(usize) -> (usize, usize, usize)) -> [[usize; 4]; 3] {
    let lowest = (0..6).min_by_key(|&i| rank(prism[i])).unwrap_or(0);
    let (turn, upside_down) = (lowest % 3, lowest >= 3);
    let v = |i: usize| {
        if upside_down {
            prism[(turn + 3 - i % 3) % 3 + 3 * (1 - i / 3)]
        } else {
            prism[(turn + i) % 3 + 3 * (i / 3)]
        }
    };
    let r = |i: usize| rank(v(i));
    if r(1).min(r(5)) < r(2).min(r(4)) {
        [
            [v(0), v(1), v(2), v(5)],
            [v(0), v(1), v(5), v(4)],
            [v(0), v(4), v(5), v(3)],
        ]
    } else {
        [
            [v(0), v(1), v(2), v(4)],
            [v(0), v(4), v(2), v(5)],
            [v(0), v(4), v(5), v(3)],
        ]
    }
}

/// Tetrahedra of the prisms over triangles of the section in one layer.
pub(super) fn extruded(
    triangles: impl Iterator<Item = [usize; 3]>,
    layer: usize,
    per_layer: usize,
    rank: impl Fn(usize) -> (usize, usize, usize) + Copy,
) -> impl Iterator<Item = [usize; 4]> {
    let (below, above) = (layer * per_layer, (layer + 1) * per_layer);
    triangles.flat_map(move |[i, j, k]| {
        let prism = [
            below + i,
            below + j,
            below + k,
            above + i,
            above + j,
            above + k,
        ];
        split(prism, rank)
    })
}

/// Nodes at x = 0, and at the length.
pub(super) fn end_faces(nodes: &[[f64; 3]], length_m: f64) -> [Vec<usize>; 2] {
    [0.0, length_m].map(|x| {
        (0..nodes.len())
            .filter(|&i| (nodes[i][0] - x).abs() < 1e-12 * length_m)
            .collect()
    })
}

/// Numbers and gradings of a structured mesh.
struct Sizes {
    rings: usize,
    around: usize,
    layers: usize,
    layer_grading: f64,
    ring_grading: f64,
}

/// How edges within the body run: the outline's are always curved.
#[derive(Clone, Copy, PartialEq)]
enum Within {
    Straight,
    AsOutline,
}

fn sizes(profile: &Profile, length_m: f64, quality: Quality) -> Sizes {
    let along = |per_diameter: f64| layers_along(profile, length_m, per_diameter);
    if let (Profile::StackedDiscs { discs, .. }, Quality::Standard | Quality::Fine) =
        (profile, quality)
    {
        // The waists ask for resolution, not only the rims: no grading along the body.
        let fine = quality == Quality::Fine;
        let (rings, around, each) = if fine { (3, 14, 8) } else { (2, 10, 6) };
        return Sizes {
            rings,
            around,
            layers: each * (discs - 1),
            layer_grading: 1.0,
            ring_grading: 0.4,
        };
    }
    match quality {
        Quality::Standard => Sizes {
            rings: 2,
            around: 10,
            layers: along(5.1),
            layer_grading: 0.25,
            ring_grading: 0.2,
        },
        Quality::Fine => Sizes {
            rings: 3,
            around: 14,
            layers: along(6.4),
            layer_grading: 0.15,
            ring_grading: 0.08,
        },
        Quality::Custom {
            rings,
            layers,
            around,
            layer_grading_per_mille,
            ring_grading_per_mille,
        } => Sizes {
            rings: rings.max(1),
            around,
            layers: layers.max(1),
            layer_grading: f64::from(layer_grading_per_mille.max(1)) / 1e3,
            ring_grading: f64::from(ring_grading_per_mille.max(1)) / 1e3,
        },
    }
}

/// The mesh of `profile` between x = 0 and x = `length_m`.
pub fn mesh(length_m: f64, profile: &Profile, quality: Quality) -> Result<Mesh, FemError> {
    profile.check(length_m)?;
    quality.check()?;
    let mut sizes = sizes(profile, length_m, quality);
    let stations = crowd_to_ends(sizes.layers, sizes.layer_grading);
    match build(length_m, profile, &sizes, &stations, Within::Straight) {
        Err(FemError::InvertedElement { .. }) => {}
        done => return done,
    }
    // A fine mesh has steps of 0.7 of the standard one's.
    let step = match quality {
        Quality::Standard => 1.0,
        Quality::Fine => 0.7,
        Quality::Custom { .. } => {
            let longest = |s: f64| profile.longest_layer(s, length_m);
            let stations = crowd_where(&stations, longest, Some(sizes.layers));
            return build(length_m, profile, &sizes, &stations, Within::AsOutline).map_err(
                |error| match error {
                    FemError::InvertedElement { .. } => FemError::Parameter {
                        name: "layers",
                        value: sizes.layers as f64,
                        expected: "a larger number: elements are inverted or flat",
                    },
                    other => other,
                },
            );
        }
    };
    sizes.around = sizes
        .around
        .max((profile.fewest_around() / step).ceil() as usize);
    if profile.inner_m() > 0.0 {
        // Flat elements at the faces of a thin wall would make it stiffer.
        sizes.ring_grading = sizes.ring_grading.max(0.4);
    }
    sizes.layers = sizes.layers.max(layers_along(profile, length_m, 5.1));
    let stations = crowd_where(
        &crowd_to_ends(sizes.layers, sizes.layer_grading),
        |s| step * profile.longest_layer(s, length_m),
        None,
    );
    build(length_m, profile, &sizes, &stations, Within::AsOutline)
}

/// Layers of a body that are as many per diameter, 4 to 60.
fn layers_along(profile: &Profile, length_m: f64, per_diameter: f64) -> usize {
    let slender = length_m / (2.0 * profile.outer_m(0.0));
    ((per_diameter * slender).round() as usize).clamp(4, 60)
}

/// Stations as fine as `given`, and no further apart than `longest` allows at each place; or as
/// many as `number` says, distributed alike. Symmetric about the middle.
fn crowd_where(given: &[f64], longest: impl Fn(f64) -> f64, number: Option<usize>) -> Vec<f64> {
    const PARTS: usize = 4000;
    // Layers per length, integrated over the first half.
    let mut layer = 0;
    let mut sum = vec![0.0];
    for i in 0..PARTS {
        let s = 0.5 * (i as f64 + 0.5) / PARTS as f64;
        while layer + 2 < given.len() && s > given[layer + 1] {
            layer += 1;
        }
        let density = (1.0 / (given[layer + 1] - given[layer])).max(1.0 / longest(s));
        sum.push(sum[i] + density * 0.5 / PARTS as f64);
    }
    let n = number.unwrap_or(2 * (sum[PARTS] - 1e-9).ceil() as usize);
    let first_half = |k: usize| {
        let target = sum[PARTS] * (2 * k) as f64 / n as f64;
        let i = sum.partition_point(|v| *v <= target).clamp(1, PARTS);
        let within = (target - sum[i - 1]) / (sum[i] - sum[i - 1]);
        (0.5 * ((i - 1) as f64 + within) / PARTS as f64).min(0.5)
    };
    (0..=n)
        .map(|k| match k {
            k if 2 * k <= n => first_half(k),
            k => 1.0 - first_half(n - k),
        })
        .collect()
}

/// The mesh with layers at `stations` (0..1).
fn build(
    length_m: f64,
    profile: &Profile,
    sizes: &Sizes,
    stations: &[f64],
    within: Within,
) -> Result<Mesh, FemError> {
    let (rings, around) = (sizes.rings, sizes.around);
    let layers = stations.len() - 1;
    let hollow = profile.inner_m() > 0.0;
    let section = if hollow {
        let count = if around == 0 { 6 * (rings + 1) } else { around };
        let radii = crowd_to_ends(rings, sizes.ring_grading);
        rings_of(&radii, &vec![count; rings + 1])
    } else {
        let counts: Vec<usize> = (0..=rings)
            .map(|k| match (k, around) {
                (0, _) => 1,
                (_, 0) => 6 * k,
                (_, count) => count,
            })
            .collect();
        rings_of(&crowd_to_one(rings, sizes.ring_grading), &counts)
    };
    let prisms = section.triangles.len() * layers;
    if prisms > MOST_PRISMS {
        return Err(FemError::Parameter {
            name: "the number of prisms of the mesh",
            value: prisms as f64,
            expected: "at most 200000: choose fewer rings, layers or points around",
        });
    }
    let radius_at = |fraction: f64, s: f64| {
        profile.inner_m() + fraction * (profile.outer_m(s) - profile.inner_m())
    };
    let per_layer = section.points.len();
    let mut nodes = Vec::new();
    for &s in stations {
        for &(fraction, angle) in &section.points {
            let r = radius_at(fraction, s);
            nodes.push([length_m * s, r * angle.cos(), r * angle.sin()]);
        }
    }
    let outermost = section.ring.iter().copied().max().unwrap_or(0);
    // Diagonals start at the vertex nearest to a clamped rim: two tetrahedra meet the
    // rim's edge there, which halves the pose error against the opposite choice.
    let rank = |node: usize| {
        let (layer, ring) = (node / per_layer, section.ring[node % per_layer]);
        let from_side = if hollow {
            ring.min(outermost - ring)
        } else {
            outermost - ring
        };
        (layer.min(layers - layer), from_side, node)
    };
    let mut corners = Vec::new();
    for layer in 0..layers {
        let triangles = section.triangles.iter().copied();
        corners.extend(extruded(triangles, layer, per_layer, rank));
    }
    let tets = quadratic::raise(&mut nodes, &corners, |a, b, x| {
        let mid = [0, 1, 2].map(|k| 0.5 * (x[a][k] + x[b][k]));
        let (ka, kb) = (section.ring[a % per_layer], section.ring[b % per_layer]);
        let on_outer = ka == outermost && kb == outermost;
        let on_inner = hollow && ka == 0 && kb == 0;
        let s = mid[0] / length_m;
        let at_radius = |r: f64| {
            let scale = r / mid[1].hypot(mid[2]);
            [mid[0], mid[1] * scale, mid[2] * scale]
        };
        if on_outer || on_inner {
            return at_radius(radius_at(if on_outer { 1.0 } else { 0.0 }, s));
        }
        if within == Within::Straight {
            return mid;
        }
        let (fa, fb) = (
            section.points[a % per_layer].0,
            section.points[b % per_layer].0,
        );
        if hollow {
            return at_radius(radius_at(0.5 * (fa + fb), s));
        }
        // The straight edge of the unit disc, scaled to the radius at half its height.
        let unit = |i: usize, f: f64| {
            let angle = section.points[i % per_layer].1;
            [f * angle.cos(), f * angle.sin()]
        };
        let (ua, ub, r) = (unit(a, fa), unit(b, fb), profile.outer_m(s));
        [mid[0], 0.5 * r * (ua[0] + ub[0]), 0.5 * r * (ua[1] + ub[1])]
    });
    let [base, top] = end_faces(&nodes, length_m);
    Mesh::in_place(nodes, tets, base, top, length_m)
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
    fn standard_neck_has_about_twelve_hundred_nodes() {
        let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard).unwrap();
        assert!(
            (1000..1300).contains(&mesh.nodes_m().len()),
            "{}",
            mesh.nodes_m().len()
        );
    }

    #[test]
    fn wrong_sizes_are_named() {
        let wrong = Mesh::tube(0.1, 0.03, 0.04, Quality::Standard).unwrap_err();
        assert!(wrong.to_string().contains("inner_radius_m is 0.04"));
        assert!(Mesh::cylinder(f64::NAN, 0.03, Quality::Standard).is_err());
    }
}
