//! Windings: threads that hardly stretch, laid round a surface of the body or through a region of it.
//!
//! Two families of threads run at angles α₁ and α₂ from the direction round the surface (across x, in
//! the surface), in a region from the direction round x. A thread that is stretched by λ stores, per
//! undeformed area or volume,
//!
//! W = k/4 (λ − 1)²,  λ = |∂x/∂s|,
//!
//! k of both families together: on a surface E A of a thread over the distance of the threads, in a
//! region E of the thread times its share of the volume. They are bonded to the body: they push as
//! well as they pull. Where a surface is nearly normal to x (an end wall) there is no winding.

use crate::FemError;
use crate::chamber::outer_faces;
use crate::element::{Rule, tet10};
use crate::mesh::{Laid, Mesh, Winding, surface};
use crate::tensor::{Mat3, cross, dot, norm};

/// Sine of the angle between a surface's normal and x below which nothing is wound.
const LEAST_SLOPE: f64 = 0.5;

/// A thread at one point of the rule of the face or of the element.
#[derive(Debug, Clone, Copy)]
struct Thread {
    /// ∂N_a/∂s along the thread, 1/m; of a face the first six.
    slope: [f64; 10],
    /// k times its share of the area or volume, N m.
    weight_Nm: f64,
}

/// The threads on one face of an element, or within it.
#[derive(Debug, Clone)]
pub(crate) struct Wound {
    pub element: usize,
    /// Its nodes in the element: six of a face, or all ten.
    pub local: Vec<usize>,
    threads: Vec<Thread>,
}

/// What the threads of a face or an element contribute, by its nodes.
pub(crate) struct ThreadSums {
    pub energy_J: f64,
    pub force: [[f64; 3]; 10],
    /// ∂²W/∂x_a∂x_b.
    pub stiffness: [[[[f64; 3]; 3]; 10]; 10],
}

/// The wound faces and elements of all windings, sorted by element.
pub(crate) fn wound(mesh: &Mesh, rule: Rule) -> Result<Vec<Wound>, FemError> {
    let mut wound = Vec::new();
    for winding in mesh.windings() {
        let before = wound.len();
        match winding.laid {
            Laid::OnSurface { stiffness_N_m } => {
                wound.extend(on_surface(mesh, winding, stiffness_N_m));
            }
            Laid::InRegion { stiffness_Pa } => {
                let elements = mesh.region(&winding.on).unwrap_or_default();
                let parts = elements.into_iter();
                wound
                    .extend(parts.map(|e| within(mesh, e, winding.angles_rad, stiffness_Pa, rule)));
            }
        }
        if wound[before..].iter().all(|part| part.threads.is_empty()) {
            return Err(winding.nowhere(mesh));
        }
    }
    wound.sort_by_key(|part| part.element);
    Ok(wound)
}

/// The faces of a winding on a surface.
fn on_surface(mesh: &Mesh, winding: &Winding, stiffness_N_m: f64) -> Vec<Wound> {
    let on = |list: &[usize], n: usize| list.binary_search(&n).is_ok();
    let all_on = |list: &[usize], nodes: &[usize; 6]| nodes.iter().all(|&n| on(list, n));
    let of_chamber =
        |nodes: &[usize; 6]| (mesh.chambers().iter()).any(|(_, list)| all_on(list, nodes));
    let named = mesh.surface(&winding.on);
    let faces = outer_faces(mesh)
        .into_iter()
        .filter_map(|(element, local)| {
            let nodes = local.map(|k| mesh.tetrahedra()[element][k]);
            let x = nodes.map(|n| mesh.nodes_m()[n]);
            let belongs = match named {
                Some(list) => all_on(list, &nodes),
                // All that looks away from the axis.
                None => looks_outside(&x) && !of_chamber(&nodes),
            };
            belongs.then(|| Wound {
                element,
                local: local.to_vec(),
                threads: threads_on(&x, winding.angles_rad, stiffness_N_m, of_chamber(&nodes)),
            })
        });
    faces.collect()
}

/// Whether a face looks away from the axis all over.
fn looks_outside(x: &[[f64; 3]; 6]) -> bool {
    let mut outside = true;
    surface::visit(x, |p| {
        let normal = cross(p.along[0], p.along[1]);
        outside &= dot(normal, from_axis(p.at)) > 0.0;
    });
    outside
}

fn from_axis([_, y, z]: [f64; 3]) -> [f64; 3] {
    [0.0, y, z]
}

/// Directions at both angles from the direction round x, square to `normal`, which looks away from
/// what the threads go round: a positive angle is a right-handed screw. None where it is nearly x.
fn directions(normal: [f64; 3], angles_rad: [f64; 2]) -> Option<[[f64; 3]; 2]> {
    let area = norm(normal);
    let round = cross([1.0, 0.0, 0.0], normal);
    let size = norm(round);
    if size <= LEAST_SLOPE * area {
        return None;
    }
    let round = round.map(|v| v / size);
    let rise = cross(normal.map(|v| v / area), round);
    Some(
        angles_rad
            .map(|angle| std::array::from_fn(|k| angle.cos() * round[k] + angle.sin() * rise[k])),
    )
}

/// Threads on a face; `hole`: of a chamber, which they go round within.
fn threads_on(
    x: &[[f64; 3]; 6],
    angles_rad: [f64; 2],
    stiffness_N_m: f64,
    hole: bool,
) -> Vec<Thread> {
    let mut threads = Vec::new();
    surface::visit(x, |p| {
        let [t1, t2] = p.along;
        let normal = cross(t1, t2);
        let inwards = hole || dot(normal, from_axis(p.at)) < 0.0;
        let outwards = if inwards { normal.map(|v| -v) } else { normal };
        for along in directions(outwards, angles_rad).into_iter().flatten() {
            // along = c₁ t₁ + c₂ t₂ in the tangent plane.
            let [g11, g12, g22] = [dot(t1, t1), dot(t1, t2), dot(t2, t2)];
            let (b1, b2) = (dot(along, t1), dot(along, t2));
            let det = g11 * g22 - g12 * g12;
            let (c1, c2) = ((g22 * b1 - g12 * b2) / det, (g11 * b2 - g12 * b1) / det);
            let mut slope = [0.0; 10];
            for (s, [d1, d2]) in slope.iter_mut().zip(p.slope) {
                *s = c1 * d1 + c2 * d2;
            }
            threads.push(Thread {
                slope,
                weight_Nm: 0.5 * stiffness_N_m * p.weight * norm(normal),
            });
        }
    });
    threads
}

/// Threads within an element, at the points of the rule.
fn within(
    mesh: &Mesh,
    element: usize,
    angles_rad: [f64; 2],
    stiffness_Pa: f64,
    rule: Rule,
) -> Wound {
    let x = mesh.tetrahedra()[element].map(|n| mesh.nodes_m()[n]);
    let mut threads = Vec::new();
    for (lambda, weight) in rule.points() {
        let shape = tet10::shape(lambda);
        let at = [0, 1, 2].map(|k| (0..10).map(|a| shape[a] * x[a][k]).sum());
        let (gradients, det) = tet10::gradients(&x, lambda);
        for along in (directions(from_axis(at), angles_rad).into_iter()).flatten() {
            threads.push(Thread {
                slope: gradients.map(|g| dot(g, along)),
                weight_Nm: 0.5 * stiffness_Pa * weight * det,
            });
        }
    }
    Wound {
        element,
        local: (0..10).collect(),
        threads,
    }
}

impl Wound {
    /// Energy, force and stiffness with its nodes at `x`.
    pub fn at(&self, x: impl Fn(usize) -> [f64; 3]) -> ThreadSums {
        let mut sum = ThreadSums {
            energy_J: 0.0,
            force: [[0.0; 3]; 10],
            stiffness: [[[[0.0; 3]; 3]; 10]; 10],
        };
        let nodes = self.local.len();
        let mut at = [[0.0; 3]; 10];
        for (place, &local) in at.iter_mut().zip(&self.local) {
            *place = x(local);
        }
        for thread in &self.threads {
            let s = &thread.slope;
            let tangent: [f64; 3] =
                std::array::from_fn(|k| (0..nodes).map(|a| s[a] * at[a][k]).sum::<f64>());
            let stretch = norm(tangent);
            let unit = tangent.map(|v| v / stretch);
            let w = thread.weight_Nm;
            sum.energy_J += 0.5 * w * (stretch - 1.0).powi(2);
            // ∂²/∂t∂t of w/2 (|t| − 1)².
            let second: Mat3 = std::array::from_fn(|i| {
                std::array::from_fn(|k| {
                    let same = f64::from(u8::from(i == k)) * (1.0 - 1.0 / stretch);
                    w * (same + unit[i] * unit[k] / stretch)
                })
            });
            for a in 0..nodes {
                for i in 0..3 {
                    sum.force[a][i] += w * (stretch - 1.0) * s[a] * unit[i];
                }
                for b in 0..nodes {
                    for i in 0..3 {
                        for k in 0..3 {
                            sum.stiffness[a][b][i][k] += s[a] * s[b] * second[i][k];
                        }
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::mesh::BODY;

    const FACE: [[f64; 3]; 6] = [
        [0.00, 1.00, 0.10],
        [0.50, 0.90, 0.50],
        [0.90, 1.10, 0.00],
        [0.25, 1.00, 0.30],
        [0.70, 1.02, 0.25],
        [0.45, 1.08, 0.02],
    ];

    fn face(angles_rad: [f64; 2], hole: bool) -> Wound {
        Wound {
            element: 0,
            local: (0..6).collect(),
            threads: threads_on(&FACE, angles_rad, 3.0, hole),
        }
    }

    /// One tetrahedron with threads at two unequal angles, and its nodes.
    fn region() -> (Wound, Vec<[f64; 3]>) {
        let mut nodes = vec![
            [0.0, 1.0, 0.1],
            [0.9, 1.1, 0.0],
            [0.5, 0.9, 0.5],
            [0.4, 0.3, 0.2],
        ];
        let tets = Mesh::with_mid_nodes(&mut nodes, &[[0, 1, 2, 3]]).unwrap();
        let mesh = Mesh::without_faces(nodes.clone(), tets, 1.0).unwrap();
        let mesh = mesh.with_winding(BODY, [0.4, -1.1], Laid::InRegion { stiffness_Pa: 3.0 });
        let mut wound = wound(&mesh.unwrap(), Rule::Degree2).unwrap();
        (wound.swap_remove(0), nodes)
    }

    #[test]
    fn force_and_stiffness_are_derivatives_of_the_energy() {
        let (within, nodes) = region();
        for (wound, x, threads) in [
            (face([0.4, -0.4], false), FACE.to_vec(), 12),
            (face([0.4, -1.1], true), FACE.to_vec(), 12),
            (within, nodes, 8),
        ] {
            assert_eq!(wound.threads.len(), threads);
            assert!(wound.at(|a| x[a]).energy_J < 1e-25);
            let moved: Vec<[f64; 3]> = (0..x.len())
                .map(|a| std::array::from_fn(|k| x[a][k] + 0.03 * ((7 * a + 3 * k) as f64).sin()))
                .collect();
            let here = wound.at(|a| moved[a]);
            assert!(here.energy_J > 1e-5);
            let step = 1e-6;
            for b in 0..x.len() {
                for k in 0..3 {
                    let at = |sign: f64| {
                        let mut y = moved.clone();
                        y[b][k] += sign * step;
                        wound.at(|a| y[a])
                    };
                    let (up, down) = (at(1.0), at(-1.0));
                    let slope = (up.energy_J - down.energy_J) / (2.0 * step);
                    assert!((slope - here.force[b][k]).abs() < 1e-8);
                    for a in 0..x.len() {
                        for i in 0..3 {
                            let slope = (up.force[a][i] - down.force[a][i]) / (2.0 * step);
                            let given = here.stiffness[a][b][i][k];
                            assert!((slope - given).abs() < 1e-7, "{slope} {given}");
                            assert!((given - here.stiffness[b][a][k][i]).abs() < 1e-12);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_positive_angle_is_a_right_handed_screw_about_what_the_threads_go_round() {
        let y = [0.0, 2.0, 0.0];
        let [ring, screw] = directions(y, [0.0, 0.3]).unwrap();
        assert_eq!(ring, [0.0, 0.0, 1.0]);
        for (found, wanted) in screw.iter().zip([0.3f64.sin(), 0.0, 0.3f64.cos()]) {
            assert!((found - wanted).abs() < 1e-15, "{screw:?}");
        }
        assert!(directions([1.0, 0.1, 0.0], [0.0, 0.3]).is_none());
        assert!(directions([0.0; 3], [0.0, 0.3]).is_none());
    }
}
