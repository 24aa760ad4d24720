//! Closed chambers under gauge pressure.
//!
//! A pressure P does the work P dV on the wall, so the potential is Π = U − P V and the follower
//! load on the wall is −P ∂V/∂x, with the symmetric tangent −P ∂²V/∂x² (Rumpel and Schweizerhof,
//! Int. J. Numer. Meth. Engng 2003, doi 10.1002/nme.561). The volume is an integral over the closed surface,
//!
//! V = 1/3 ∮ x · (∂x/∂ξ × ∂x/∂η) dξ dη,
//!
//! exact for six-node triangles under the six-point rule. A chamber that is open at the base or at
//! the platform is closed by a rigid cap there, which is no part of the mesh: with the area vector
//! A₀ of the cap in the platform's axes, its pose (r, R) and a constant c, the cap gives
//! ((R A₀) · r + c) / 3.

use crate::FemError;
use crate::mesh::{FACES, Mesh, surface};
use crate::platform::Platform;
use crate::tensor::{Mat3, apply, cross, dot, product, skew};
use std::collections::{BTreeMap, BTreeSet};

/// One face of an element on the wall of a chamber.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallFace {
    pub element: usize,
    pub chamber: usize,
    /// Local nodes, corners first, seen so that the normal points out of the body, into the chamber.
    pub local: [usize; 6],
}

/// The rigid part of a chamber's surface.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Cap {
    /// Area vector out of the chamber in the frame of its side, m².
    area_m2: [f64; 3],
    /// ∫ x · dA with x from the side's origin, m³.
    moment_m3: f64,
}

/// All chambers of a body.
#[derive(Debug, Clone, Default)]
pub(crate) struct Chambers {
    pub names: Vec<String>,
    /// Sorted by element.
    pub faces: Vec<WallFace>,
    caps_on_platform: Vec<Cap>,
    /// Part of the caps on the base in each volume, m³.
    of_base_m3: Vec<f64>,
}

/// What the wall of a chamber contributes at one face.
pub(crate) struct FaceVolume {
    pub volume_m3: f64,
    /// ∂V/∂x by node.
    pub gradient: [[f64; 3]; 6],
    /// ∂²V/∂x_a∂x_b is the skew matrix of this vector.
    pub turn: [[[f64; 3]; 6]; 6],
}

impl Chambers {
    /// From the mesh's named surfaces.
    ///
    /// # Errors
    /// A chamber without a whole face, or whose surface is open elsewhere than at base and platform.
    pub fn new(mesh: &Mesh) -> Result<Self, FemError> {
        let mut chambers = Self::default();
        if mesh.chambers().is_empty() {
            return Ok(chambers);
        }
        let outer = outer_faces(mesh);
        for (chamber, (name, nodes)) in mesh.chambers().iter().enumerate() {
            let on = |i: &usize| nodes.binary_search(i).is_ok();
            let own: Vec<WallFace> = outer
                .iter()
                .filter(|(e, local)| local.iter().all(|&k| on(&mesh.tetrahedra()[*e][k])))
                .map(|&(element, local)| WallFace {
                    element,
                    chamber,
                    local,
                })
                .collect();
            if own.is_empty() {
                return Err(FemError::Chamber {
                    name: name.clone(),
                    problem: format!(
                        "its {} nodes hold no whole face of a tetrahedron on the surface of the body",
                        nodes.len()
                    ),
                });
            }
            let [base, platform] = caps(mesh, name, &own)?;
            chambers.names.push(name.clone());
            chambers.of_base_m3.push(base.moment_m3 / 3.0);
            chambers.caps_on_platform.push(platform);
            chambers.faces.extend(own);
        }
        chambers.faces.sort_by_key(|face| face.element);
        let rest = |node: usize| mesh.nodes_m()[node];
        let at_rest = chambers.volumes_m3(mesh, rest, &Platform::at_rest(mesh.length_m()));
        if let Some(c) = at_rest.iter().position(|v| v.is_nan() || *v <= 0.0) {
            return Err(FemError::Chamber {
                name: chambers.names[c].clone(),
                problem: format!(
                    "its volume is {:.3e} m^3; expected a closed surface round a cavity",
                    at_rest[c]
                ),
            });
        }
        Ok(chambers)
    }

    pub fn count(&self) -> usize {
        self.names.len()
    }

    /// Volumes with the nodes at `at`, m³.
    pub fn volumes_m3(
        &self,
        mesh: &Mesh,
        at: impl Fn(usize) -> [f64; 3],
        platform: &Platform,
    ) -> Vec<f64> {
        let mut volumes: Vec<f64> = (0..self.count())
            .map(|c| self.of_caps_m3(c, platform))
            .collect();
        for face in &self.faces {
            let x = face.local.map(|k| at(mesh.tetrahedra()[face.element][k]));
            volumes[face.chamber] -= volume_under(&x);
        }
        volumes
    }

    /// Part of the caps in the volume of a chamber, m³.
    pub fn of_caps_m3(&self, chamber: usize, platform: &Platform) -> f64 {
        let cap = &self.caps_on_platform[chamber];
        let area = apply(&platform.rotation, cap.area_m2);
        self.of_base_m3[chamber] + (dot(area, platform.position_m) + cap.moment_m3) / 3.0
    }

    /// ∂V/∂(δr, δφ) of the platform's cap, and its tangent.
    pub fn of_cap(&self, chamber: usize, platform: &Platform) -> ([f64; 6], [[f64; 6]; 6]) {
        let area = apply(&platform.rotation, self.caps_on_platform[chamber].area_m2);
        let r = platform.position_m;
        let moment = cross(area, r);
        let (of_area, of_r) = (skew(area), skew(r));
        let both: Mat3 = product(&of_r, &of_area);
        let mut gradient = [0.0; 6];
        let mut tangent = [[0.0; 6]; 6];
        for i in 0..3 {
            gradient[i] = area[i] / 3.0;
            gradient[3 + i] = moment[i] / 3.0;
            for j in 0..3 {
                tangent[i][3 + j] = -of_area[i][j] / 3.0;
                tangent[3 + i][j] = of_area[i][j] / 3.0;
                tangent[3 + i][3 + j] = both[i][j] / 3.0;
            }
        }
        (gradient, tangent)
    }

    /// Whether the wall of a chamber passes through itself or a cap; `at` gives the place of a node.
    ///
    /// A face is taken as the four flat triangles between its six nodes.
    pub fn collapsed(&self, mesh: &Mesh, at: impl Fn(usize) -> [f64; 3]) -> bool {
        (0..self.count()).any(|chamber| {
            let mut wall: Vec<Triangle> = Vec::new();
            let mut rim: BTreeMap<(usize, usize), [usize; 2]> = BTreeMap::new();
            for face in self.faces.iter().filter(|f| f.chamber == chamber) {
                let nodes = face.local.map(|k| mesh.tetrahedra()[face.element][k]);
                for quarter in QUARTERS.map(|corners| corners.map(|k| nodes[k])) {
                    toggle_edges(&mut rim, quarter);
                    wall.push((quarter, quarter.map(&at)));
                }
            }
            let on_rim: BTreeSet<usize> = rim.values().flatten().copied().collect();
            let caps = [false, true].map(|top| {
                let middle = 0.5 * mesh.length_m();
                let own = (rim.values()).filter(|e| (mesh.nodes_m()[e[0]][0] > middle) == top);
                own.map(|e| e.map(&at)).collect::<Vec<_>>()
            });
            let meets_a_cap = |(nodes, corners): &Triangle| {
                (0..3).map(|k| [k, (k + 1) % 3]).any(|edge| {
                    let [p, q] = edge.map(|k| corners[k]);
                    !edge.iter().any(|&k| on_rim.contains(&nodes[k]))
                        && caps.iter().any(|cap| turns_round(cap, p, q) != 0)
                })
            };
            wall.iter().any(meets_a_cap) || cross_each_other(&mut wall)
        })
    }
}

/// How often the edges of a flat cap go round where the way from `p` to `q` meets its plane.
fn turns_round(cap: &[[[f64; 3]; 2]], p: [f64; 3], q: [f64; 3]) -> i32 {
    let fan = cap.iter().map(|&[i, j]| [cap[0][0], i, j]);
    fan.map(|triangle| through(p, q, &triangle)).sum()
}

/// The four triangles between the nodes of a face.
const QUARTERS: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];

/// Nodes and corners of a flat triangle of a wall.
type Triangle = ([usize; 3], [[f64; 3]; 3]);

/// Least and largest coordinate `k` of a triangle.
fn reach((_, corners): &Triangle, k: usize) -> [f64; 2] {
    let [a, b, c] = corners.map(|x| x[k]);
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Whether triangles without a common node cross.
fn cross_each_other(wall: &mut [Triangle]) -> bool {
    wall.sort_by(|a, b| reach(a, 0)[0].total_cmp(&reach(b, 0)[0]));
    let beside = |a, b, k| reach(a, k)[0] <= reach(b, k)[1] && reach(b, k)[0] <= reach(a, k)[1];
    let joined = |a: &Triangle, b: &Triangle| a.0.iter().any(|n| b.0.contains(n));
    let pierces = |(_, x): &Triangle, (_, other): &Triangle| {
        (0..3).any(|k| through(x[k], x[(k + 1) % 3], other) != 0)
    };
    wall.iter().enumerate().any(|(i, a)| {
        let near = wall[i + 1..].iter().take_while(|b| beside(a, b, 0));
        near.filter(|b| beside(a, b, 1) && beside(a, b, 2) && !joined(a, b))
            .any(|b| pierces(a, b) || pierces(b, a))
    })
}

/// 1 where the way from `p` to `q` goes through a triangle along its normal, -1 against it, else 0.
fn through(p: [f64; 3], q: [f64; 3], triangle: &[[f64; 3]; 3]) -> i32 {
    let [a, b, c] = *triangle;
    let normal = cross(minus(b, a), minus(c, a));
    let [before, behind] = [p, q].map(|x| dot(minus(x, a), normal));
    if (before < 0.0) == (behind < 0.0) {
        return 0;
    }
    let share = before / (before - behind);
    let point = [0, 1, 2].map(|k| p[k] + share * (q[k] - p[k]));
    let within = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(from, to)| dot(cross(minus(to, from), minus(point, from)), normal) > 0.0);
    match within {
        true if before < 0.0 => 1,
        true => -1,
        false => 0,
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

/// Faces that belong to one element only, by local nodes.
pub(crate) fn outer_faces(mesh: &Mesh) -> Vec<(usize, [usize; 6])> {
    let mut seen: BTreeMap<[usize; 3], Option<(usize, [usize; 6])>> = BTreeMap::new();
    for (e, tet) in mesh.tetrahedra().iter().enumerate() {
        for local in FACES {
            let mut key = [tet[local[0]], tet[local[1]], tet[local[2]]];
            key.sort_unstable();
            seen.entry(key)
                .and_modify(|known| *known = None)
                .or_insert(Some((e, local)));
        }
    }
    let mut faces: Vec<_> = seen.into_values().flatten().collect();
    faces.sort_by_key(|(e, local)| (*e, *local));
    faces
}

/// Adds the directed edges of a triangle; those that come back go.
fn toggle_edges(rim: &mut BTreeMap<(usize, usize), [usize; 2]>, corners: [usize; 3]) {
    for k in 0..3 {
        let (i, j) = (corners[k], corners[(k + 1) % 3]);
        let key = (i.min(j), i.max(j));
        if rim.remove(&key).is_none() {
            rim.insert(key, [i, j]);
        }
    }
}

/// Caps over the open edges of a chamber's wall: on the base, and on the platform.
fn caps(mesh: &Mesh, name: &str, wall: &[WallFace]) -> Result<[Cap; 2], FemError> {
    let x = mesh.nodes_m();
    let mut rim: BTreeMap<(usize, usize), [usize; 2]> = BTreeMap::new();
    let mut middle: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for face in wall {
        let nodes = face.local.map(|k| mesh.tetrahedra()[face.element][k]);
        // The other way round: out of the chamber.
        toggle_edges(&mut rim, [nodes[2], nodes[1], nodes[0]]);
        for k in 0..3 {
            let (i, j) = (nodes[k], nodes[(k + 1) % 3]);
            middle.insert((i.min(j), i.max(j)), nodes[3 + k]);
        }
    }
    let mut caps = [Cap::default(); 2];
    let origin = [[0.0; 3], [mesh.length_m(), 0.0, 0.0]];
    for (key, [i, j]) in rim {
        let m = middle[&key];
        let on = |nodes: &[usize]| [i, j, m].iter().all(|n| nodes.binary_search(n).is_ok());
        let side = match (on(mesh.base_nodes()), on(mesh.top_nodes())) {
            (true, _) => 0,
            (_, true) => 1,
            _ => {
                return Err(FemError::Chamber {
                    name: name.into(),
                    problem: format!(
                        "its surface is open at ({:.4}, {:.4}, {:.4}) m, which lies neither on the \
                         base nor on the top",
                        x[m][0], x[m][1], x[m][2]
                    ),
                });
            }
        };
        let [a, b, c] = [i, j, m].map(|n| minus(x[n], origin[side]));
        let half = |v: [f64; 3]| v.map(|w| 0.5 * w);
        // The cap's edge runs against the wall's.
        let triangle = [[0.0; 3], b, a, half(b), c, half(a)];
        surface::visit(&triangle, |point| {
            let normal = cross(point.along[0], point.along[1]);
            for k in 0..3 {
                caps[side].area_m2[k] += point.weight * normal[k];
            }
            caps[side].moment_m3 += point.weight * dot(point.at, normal);
        });
    }
    Ok(caps)
}

/// 1/3 ∫ x · dA of one face.
fn volume_under(x: &[[f64; 3]; 6]) -> f64 {
    let mut sum = 0.0;
    surface::visit(x, |p| {
        sum += p.weight * dot(p.at, cross(p.along[0], p.along[1])) / 3.0;
    });
    sum
}

/// Volume between a wall face and the origin, as part of its chamber, with its derivatives.
pub(crate) fn face_volume(x: &[[f64; 3]; 6]) -> FaceVolume {
    let mut sum = FaceVolume {
        volume_m3: 0.0,
        gradient: [[0.0; 3]; 6],
        turn: [[[0.0; 3]; 6]; 6],
    };
    surface::visit(x, |p| {
        let [t1, t2] = p.along;
        // The face looks into the chamber.
        let w = -p.weight / 3.0;
        let (n, along_1, along_2) = (cross(t1, t2), cross(t2, p.at), cross(p.at, t1));
        sum.volume_m3 += w * dot(p.at, n);
        for a in 0..6 {
            let (na, [da1, da2]) = (p.shape[a], p.slope[a]);
            for k in 0..3 {
                sum.gradient[a][k] += w * (na * n[k] + da1 * along_1[k] + da2 * along_2[k]);
            }
            for b in 0..6 {
                let (nb, [db1, db2]) = (p.shape[b], p.slope[b]);
                let (of_t2, of_t1, of_x) = (
                    da1 * nb - na * db1,
                    na * db2 - da2 * nb,
                    da2 * db1 - da1 * db2,
                );
                for k in 0..3 {
                    sum.turn[a][b][k] += w * (of_t2 * t2[k] + of_t1 * t1[k] + of_x * p.at[k]);
                }
            }
        }
    });
    sum
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::mesh::{ChamberShape, Chambered, Quality};

    #[test]
    fn a_wall_that_passes_through_a_cap_or_another_wall_is_collapsed() {
        let (length_m, offset_m) = (0.1, 0.012);
        let body = Chambered {
            length_m,
            radius_m: 0.02,
            channel_radius_m: 0.0,
            chambers: 3,
            shape: ChamberShape::Round {
                radius_m: 0.0045,
                offset_m,
            },
            end_wall_m: 0.0,
        };
        let mesh = Mesh::chambered(&body, Quality::Standard).unwrap();
        let chambers = Chambers::new(&mesh).unwrap();
        // The wall of the chamber towards y leans over the platform, nearer to its axis or farther,
        // or is narrower in its middle, down to beyond its axis.
        let moved = |over: f64, wider: f64| {
            chambers.collapsed(&mesh, |n| {
                let [x, y, z] = mesh.nodes_m()[n];
                let own = if y > 0.0 { 4.0 * x / length_m } else { 0.0 };
                let bump = own * (1.0 - x / length_m);
                let wide = 1.0 + wider * bump;
                let aside = offset_m + wide * (y - offset_m);
                [x + over * length_m * bump, aside, wide * z]
            })
        };
        assert!(!moved(0.0, 0.0) && !moved(0.0, -0.9) && moved(0.0, -1.1));
        assert!(!moved(0.2, -0.5) && moved(0.5, -0.5) && !moved(0.5, 0.3));
    }

    #[test]
    fn gradient_and_tangent_of_a_face_are_those_of_its_volume() {
        let x = [
            [1.0, 0.1, 0.2],
            [1.3, 0.9, 0.1],
            [0.8, 0.2, 1.1],
            [1.2, 0.5, 0.1],
            [1.1, 0.6, 0.7],
            [0.9, 0.1, 0.6],
        ];
        let here = face_volume(&x);
        let step = 1e-5;
        for b in 0..6 {
            for k in 0..3 {
                let moved = |sign: f64| {
                    let mut y = x;
                    y[b][k] += sign * step;
                    face_volume(&y)
                };
                let (up, down) = (moved(1.0), moved(-1.0));
                let slope = (up.volume_m3 - down.volume_m3) / (2.0 * step);
                assert!((slope - here.gradient[b][k]).abs() < 1e-9);
                for a in 0..6 {
                    for i in 0..3 {
                        let slope = (up.gradient[a][i] - down.gradient[a][i]) / (2.0 * step);
                        assert!((slope - skew(here.turn[a][b])[i][k]).abs() < 1e-9);
                    }
                }
            }
        }
    }
}
