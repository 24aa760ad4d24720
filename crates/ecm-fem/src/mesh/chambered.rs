//! Cylinders with chambers round their axis.
//!
//! Each chamber has a block of its own: rings between the outline of its share of the cross-section
//! (an arc of the channel or of the core, two radial sides, an arc of the rim) and its hole, with as
//! many points on both. Neighbours share the points of their sides. The section is extruded along x;
//! within the end walls the holes are filled.

use super::quadratic::{mid_nodes_of_faces, raise};
use super::revolve::{crowd_to_ends, end_faces, extruded};
use super::{Mesh, Quality};
use crate::FemError;
use std::f64::consts::{PI, TAU};

/// Cross-section of a chamber; the first lies in the direction of y, the others follow towards z.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ChamberShape {
    /// A circle.
    Round {
        /// Its radius.
        radius_m: f64,
        /// Distance of its centre from the axis.
        offset_m: f64,
    },
    /// A part of a ring.
    Sector {
        /// Radius of its inner arc.
        inner_radius_m: f64,
        /// Radius of its outer arc.
        outer_radius_m: f64,
        /// Angle, rad.
        angle_rad: f64,
    },
}

/// A cylinder along x with equal chambers round its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chambered {
    /// Length between base and platform.
    pub length_m: f64,
    /// Outer radius.
    pub radius_m: f64,
    /// Radius of a channel along the axis, which is under no pressure; 0: none.
    pub channel_radius_m: f64,
    /// Number of chambers, 2 to 12.
    pub chambers: usize,
    /// Their cross-section.
    pub shape: ChamberShape,
    /// Thickness of the wall at both ends; 0: base and platform close the chambers.
    pub end_wall_m: f64,
}

/// Thinnest wall over the outer radius.
const THINNEST: f64 = 0.02;

impl Chambered {
    fn check(&self) -> Result<(), FemError> {
        let refused = |name, value, expected| {
            Err(FemError::Parameter {
                name,
                value,
                expected,
            })
        };
        for (name, value) in [("length_m", self.length_m), ("radius_m", self.radius_m)] {
            if !(value.is_finite() && value > 0.0) {
                return refused(name, value, "a positive length in metres");
            }
        }
        if !(2..=12).contains(&self.chambers) {
            return refused("chambers", self.chambers as f64, "2 to 12");
        }
        let ends = 0.0..0.4 * self.length_m;
        if !ends.contains(&self.end_wall_m) {
            let expected = "0, or less than 0.4 of the length";
            return refused("end_wall_m", self.end_wall_m, expected);
        }
        let channel = self.channel_radius_m;
        if !(channel == 0.0 || channel >= THINNEST * self.radius_m) {
            return refused(
                "channel_radius_m",
                channel,
                "0, or at least 2 % of the radius",
            );
        }
        let half = PI / self.chambers as f64;
        // Distances of the hole from axis, rim and the neighbour's share.
        let (inner, outer, aside, sizes) = match self.shape {
            ChamberShape::Round { radius_m, offset_m } => (
                offset_m - radius_m,
                offset_m + radius_m,
                offset_m * half.min(0.5 * PI).sin() - radius_m,
                radius_m > 0.0,
            ),
            ChamberShape::Sector {
                inner_radius_m,
                outer_radius_m,
                angle_rad,
            } => (
                inner_radius_m,
                outer_radius_m,
                inner_radius_m * (half - 0.5 * angle_rad).min(0.5 * PI).sin(),
                angle_rad > 0.0 && outer_radius_m > inner_radius_m,
            ),
        };
        let wall = (inner - channel).min(self.radius_m - outer).min(aside);
        if !(sizes && wall >= THINNEST * self.radius_m) {
            return refused(
                "the thinnest wall beside a chamber, m,",
                wall,
                "at least 2 % of the radius: make the chambers smaller or fewer",
            );
        }
        Ok(())
    }

    /// Place in the cross-section of a point on the hole of the first chamber: `around` is the place
    /// of the same point on the outline of its share, `u` and `v` (−1..1) tell angle and radius there.
    fn hole(&self, around: [f64; 2], u: f64, v: f64) -> [f64; 2] {
        match self.shape {
            ChamberShape::Round { radius_m, offset_m } => {
                let from_centre = [around[0] - offset_m, around[1]];
                let scale = radius_m / from_centre[0].hypot(from_centre[1]);
                [offset_m + scale * from_centre[0], scale * from_centre[1]]
            }
            ChamberShape::Sector {
                inner_radius_m,
                outer_radius_m,
                angle_rad,
            } => {
                let r = 0.5 * ((1.0 - v) * inner_radius_m + (1.0 + v) * outer_radius_m);
                polar(r, 0.5 * u * angle_rad)
            }
        }
    }
}

fn polar(r: f64, angle: f64) -> [f64; 2] {
    [r * angle.cos(), r * angle.sin()]
}

fn turned(x: [f64; 2], angle: f64) -> [f64; 2] {
    let (s, c) = angle.sin_cos();
    [c * x[0] - s * x[1], s * x[0] + c * x[1]]
}

/// Triangles of the cross-section, and where they lie.
#[derive(Default)]
struct Section {
    points: Vec<[f64; 2]>,
    /// Places of each point in the blocks that it belongs to.
    places: Vec<Vec<Place>>,
    /// Triangles of the wall, and below of the fillings.
    walls: Vec<[usize; 3]>,
    fillings: Vec<[usize; 3]>,
    /// Points on the hole of each chamber, and within it.
    holes: Vec<Vec<usize>>,
}

/// Place within the block of a chamber: steps along the outline, and the share of the way from the
/// hole to it.
#[derive(Clone, Copy)]
struct Place {
    chamber: usize,
    along: f64,
    outwards: f64,
}

impl Section {
    fn point(&mut self, x: [f64; 2], place: Option<Place>) -> usize {
        self.points.push(x);
        self.places.push(place.into_iter().collect());
        self.points.len() - 1
    }

    /// The point at a place, made where there is none.
    fn shared(&mut self, x: [f64; 2], place: Option<Place>, scale: f64) -> usize {
        let near = |y: &[f64; 2]| (x[0] - y[0]).hypot(x[1] - y[1]) < 1e-9 * scale;
        match self.points.iter().position(near) {
            Some(known) => {
                self.places[known].extend(place);
                known
            }
            None => self.point(x, place),
        }
    }

    /// The place in the middle of an edge, where both ends lie in one block.
    fn middle(&self, a: usize, b: usize, steps: usize) -> Option<Place> {
        self.places[a].iter().find_map(|p| {
            let q = (self.places[b].iter()).find(|q| q.chamber == p.chamber)?;
            let n = steps as f64;
            let further = (q.along - p.along + 1.5 * n) % n - 0.5 * n;
            // A diagonal over a corner of the hole is none of its edges.
            (further.abs() < 1.5).then_some(Place {
                chamber: p.chamber,
                along: (p.along + 0.5 * further + n) % n,
                outwards: 0.5 * (p.outwards + q.outwards),
            })
        })
    }

    /// Two triangles of a quadrilateral whose corners run anticlockwise, cut along its shorter
    /// diagonal.
    fn halves(&self, [a, b, c, d]: [usize; 4]) -> [[usize; 3]; 2] {
        let x = |i: usize| self.points[i];
        let length = |i: usize, j: usize| (x(i)[0] - x(j)[0]).hypot(x(i)[1] - x(j)[1]);
        if length(a, c) <= length(b, d) {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        }
    }
}

/// Numbers of the mesh: segments of an arc and of a radial side of one share, rings of the wall.
struct Counts {
    arc: usize,
    side: usize,
    rings: usize,
    layers: usize,
    /// Layers of each end wall.
    ends: usize,
}

impl Counts {
    fn of(body: &Chambered, quality: Quality) -> Self {
        let slender = body.length_m / (2.0 * body.radius_m);
        let along = |per: f64| ((per * slender).round() as usize).clamp(6, 60);
        let around = |all: usize| all.div_ceil(body.chambers).max(2);
        match quality {
            Quality::Standard => Self {
                arc: around(9),
                side: 2,
                rings: 1,
                layers: along(5.1),
                ends: 1,
            },
            Quality::Fine => Self {
                arc: around(12),
                side: 3,
                rings: 2,
                layers: along(6.4),
                ends: 2,
            },
            Quality::Custom {
                rings,
                layers,
                around: all,
                ..
            } => Self {
                arc: around(all.max(6)),
                side: (1 + rings).max(2),
                rings: rings.max(1),
                layers: layers.max(2),
                ends: rings.max(1),
            },
        }
    }
}

impl Counts {
    /// Steps along the outline of a share.
    fn steps(&self) -> usize {
        2 * (self.arc + self.side)
    }

    /// Angle and radius, from −1 to 1, after so many steps along the outline: the outer arc towards
    /// larger angles, inwards, the inner arc back, and outwards.
    fn outline(&self, steps: f64) -> (f64, f64) {
        let (arc, side) = (self.arc as f64, self.side as f64);
        match steps {
            t if t < arc => (2.0 * t / arc - 1.0, 1.0),
            t if t < arc + side => (1.0, 1.0 - 2.0 * (t - arc) / side),
            t if t < 2.0 * arc + side => (1.0 - 2.0 * (t - arc - side) / arc, -1.0),
            t => (-1.0, 2.0 * (t - 2.0 * arc - side) / side - 1.0),
        }
    }
}

/// Radius of the channel, or of the core where there is none.
fn core_radius_m(body: &Chambered) -> f64 {
    let first_hole = match body.shape {
        ChamberShape::Round { radius_m, offset_m } => offset_m - radius_m,
        ChamberShape::Sector { inner_radius_m, .. } => inner_radius_m,
    };
    if body.channel_radius_m > 0.0 {
        body.channel_radius_m
    } else {
        0.6 * first_hole
    }
}

fn position(body: &Chambered, counts: &Counts, place: Place) -> [f64; 2] {
    let (u, v) = counts.outline(place.along);
    let core = core_radius_m(body);
    let r = 0.5 * ((1.0 - v) * core + (1.0 + v) * body.radius_m);
    let around = polar(r, u * PI / body.chambers as f64);
    let hole = body.hole(around, u, v);
    let x = [0, 1].map(|k| hole[k] + place.outwards * (around[k] - hole[k]));
    turned(x, TAU * place.chamber as f64 / body.chambers as f64)
}

fn section(body: &Chambered, counts: &Counts) -> Section {
    let mut section = Section::default();
    let n = body.chambers;
    let steps = counts.steps();
    for chamber in 0..n {
        let mut rings: Vec<Vec<usize>> = Vec::new();
        for ring in 0..=counts.rings {
            let row = (0..steps).map(|i| {
                let place = Place {
                    chamber,
                    along: i as f64,
                    outwards: ring as f64 / counts.rings as f64,
                };
                let x = position(body, counts, place);
                if ring == counts.rings {
                    section.shared(x, Some(place), body.radius_m)
                } else {
                    section.point(x, Some(place))
                }
            });
            let row: Vec<usize> = row.collect();
            rings.push(row);
        }
        for pair in rings.windows(2) {
            for i in 0..steps {
                let next = (i + 1) % steps;
                let quad = [pair[0][i], pair[1][i], pair[1][next], pair[0][next]];
                let halves = section.halves(quad);
                section.walls.extend(halves);
            }
        }
        let turn = TAU * chamber as f64 / n as f64;
        let inside = fill(&mut section, body, counts, &rings[0], turn);
        section.holes.push(inside);
    }
    if body.channel_radius_m == 0.0 {
        fill_core(
            &mut section,
            n * counts.arc,
            core_radius_m(body),
            PI / n as f64,
        );
    }
    section
}

/// Triangles over a hole, and all points on and within it.
fn fill(
    section: &mut Section,
    body: &Chambered,
    counts: &Counts,
    hole: &[usize],
    turn: f64,
) -> Vec<usize> {
    let mut points = hole.to_vec();
    match body.shape {
        ChamberShape::Round { offset_m, .. } => {
            let centre = section.point(polar(offset_m, turn), None);
            points.push(centre);
            for (i, &a) in hole.iter().enumerate() {
                let b = hole[(i + 1) % hole.len()];
                section.fillings.push([centre, a, b]);
            }
        }
        ChamberShape::Sector { .. } => {
            let (arc, side) = (counts.arc, counts.side);
            // The outline runs along the outer arc, down, back along the inner arc, and up.
            let mut grid = vec![vec![0; arc + 1]; side + 1];
            for k in 0..=arc {
                grid[side][k] = hole[k];
                grid[0][k] = hole[(arc + side + arc - k) % hole.len()];
            }
            for k in 1..side {
                grid[side - k][arc] = hole[arc + k];
                grid[k][0] = hole[2 * arc + side + k];
            }
            for (j, row) in grid.iter_mut().enumerate().take(side).skip(1) {
                for (i, point) in row.iter_mut().enumerate().take(arc).skip(1) {
                    let u = 2.0 * i as f64 / arc as f64 - 1.0;
                    let v = 2.0 * j as f64 / side as f64 - 1.0;
                    *point = section.point(turned(body.hole([0.0; 2], u, v), turn), None);
                    points.push(*point);
                }
            }
            for j in 0..side {
                for i in 0..arc {
                    let quad = [
                        grid[j][i],
                        grid[j + 1][i],
                        grid[j + 1][i + 1],
                        grid[j][i + 1],
                    ];
                    let halves = section.halves(quad);
                    section.fillings.extend(halves);
                }
            }
        }
    }
    points
}

/// The core within the inner arcs: a ring of half as many points, and the axis.
fn fill_core(section: &mut Section, around: usize, core: f64, half: f64) {
    let rim: Vec<usize> = (0..around)
        .map(|k| {
            section.shared(
                polar(core, TAU * k as f64 / around as f64 - half),
                None,
                core,
            )
        })
        .collect();
    let axis = section.point([0.0; 2], None);
    for (k, &a) in rim.iter().enumerate() {
        section.walls.push([axis, a, rim[(k + 1) % around]]);
    }
}

impl Mesh {
    /// A cylinder along x with chambers named `chamber_1`, `chamber_2`, … round its axis.
    ///
    /// # Errors
    /// Sizes that leave no wall, named; a quality whose elements are inverted.
    pub fn chambered(body: &Chambered, quality: Quality) -> Result<Self, FemError> {
        quality.check()?;
        body.check()?;
        let counts = Counts::of(body, quality);
        let section = section(body, &counts);
        let ends = if body.end_wall_m > 0.0 {
            counts.ends
        } else {
            0
        };
        let (wall, length) = (body.end_wall_m, body.length_m);
        let mut stations: Vec<f64> = (0..ends).map(|k| wall * k as f64 / ends as f64).collect();
        for s in crowd_to_ends(counts.layers, 0.4) {
            stations.push(wall + s * (length - 2.0 * wall));
        }
        stations.extend((1..=ends).map(|k| length - wall + wall * k as f64 / ends as f64));
        let last = stations.len() - 1;
        stations[last] = length;
        let per_layer = section.points.len();
        let all: Vec<[f64; 3]> = stations
            .iter()
            .flat_map(|&x| section.points.iter().map(move |p| [x, p[0], p[1]]))
            .collect();
        let mut corners = Vec::new();
        let rank = |node: usize| {
            let layer = node / per_layer;
            (layer.min(last - layer), 0, node)
        };
        for layer in 0..last {
            let filled = layer < ends || layer >= last - ends;
            let fillings: &[[usize; 3]] = if filled { &section.fillings } else { &[] };
            let triangles = section.walls.iter().chain(fillings);
            let triangles = triangles.filter_map(|t| anticlockwise(&section, *t));
            corners.extend(extruded(triangles, layer, per_layer, rank));
        }
        let inside: Vec<Vec<usize>> = section
            .holes
            .iter()
            .map(|points| {
                (ends..=last - ends)
                    .flat_map(|layer| points.iter().map(move |p| layer * per_layer + p))
                    .collect()
            })
            .collect();
        let curved = |a: usize, b: usize, x: &[[f64; 3]]| {
            let mid = [0, 1, 2].map(|k| 0.5 * (x[a][k] + x[b][k]));
            let middle = section.middle(a % per_layer, b % per_layer, counts.steps());
            middle.map_or(mid, |place| {
                let [y, z] = position(body, &counts, place);
                [mid[0], y, z]
            })
        };
        let mut nodes = all;
        let tets = raise(&mut nodes, &corners, curved);
        let (nodes, tets, of_old) = without_unused(nodes, tets);
        let [base, top] = end_faces(&nodes, length);
        let mut mesh = Self::in_place(nodes, tets, base, top, length)?;
        for (k, points) in inside.iter().enumerate() {
            let mut wall: Vec<usize> = points.iter().filter_map(|&p| of_old[p]).collect();
            wall.sort_unstable();
            let middle = mid_nodes_of_faces(&mesh.tetrahedra, &wall);
            wall.extend(middle);
            mesh = mesh.with_chamber(&format!("chamber_{}", k + 1), wall)?;
        }
        Ok(mesh)
    }
}

/// A triangle with its corners anticlockwise; none where it is flat.
fn anticlockwise(section: &Section, [a, b, c]: [usize; 3]) -> Option<[usize; 3]> {
    let [x, y, z] = [a, b, c].map(|i| section.points[i]);
    let twice_area = (y[0] - x[0]) * (z[1] - x[1]) - (y[1] - x[1]) * (z[0] - x[0]);
    match twice_area {
        0.0 => None,
        area if area < 0.0 => Some([a, c, b]),
        _ => Some([a, b, c]),
    }
}

type Renumbered = (Vec<[f64; 3]>, Vec<[usize; 10]>, Vec<Option<usize>>);

/// Without the nodes within the chambers, which no element uses; and the new number of each node.
fn without_unused(nodes: Vec<[f64; 3]>, mut tets: Vec<[usize; 10]>) -> Renumbered {
    let mut used = vec![false; nodes.len()];
    tets.iter().flatten().for_each(|&node| used[node] = true);
    let mut count = 0;
    let numbers: Vec<Option<usize>> = used
        .iter()
        .map(|&used| {
            count += usize::from(used);
            used.then(|| count - 1)
        })
        .collect();
    for node in tets.iter_mut().flatten() {
        *node = numbers[*node].unwrap_or_default();
    }
    let kept = nodes.into_iter().zip(&used).filter(|(_, used)| **used);
    (kept.map(|(x, _)| x).collect(), tets, numbers)
}
