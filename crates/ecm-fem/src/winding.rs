//! Windings: threads that hardly stretch, laid round a surface of the body.
//!
//! Two families of threads run at the angles ±α from the direction round the surface (across x, in
//! the surface). A thread that is stretched by λ stores, per undeformed area,
//!
//! W = k/2 (λ − 1)²,  λ = |∂x/∂s|,
//!
//! k its stiffness E A over the distance of the threads. They are bonded to the body: they push as
//! well as they pull. Where the surface is nearly normal to x (an end wall) there is no winding.

use crate::FemError;
use crate::chamber::outer_faces;
use crate::mesh::{Mesh, surface};
use crate::tensor::{cross, dot, norm};

/// Sine of the angle between a surface's normal and x below which nothing is wound.
const LEAST_SLOPE: f64 = 0.5;

/// A thread at one point of the surface rule.
#[derive(Debug, Clone, Copy)]
struct Thread {
    /// ∂N_a/∂s along the thread, 1/m.
    slope: [f64; 6],
    /// k times its share of the area, N m.
    weight_Nm: f64,
}

/// The threads on one face of an element.
#[derive(Debug, Clone)]
pub(crate) struct WoundFace {
    pub element: usize,
    pub local: [usize; 6],
    threads: Vec<Thread>,
}

/// What the threads of a face contribute.
pub(crate) struct FaceThreads {
    pub energy_J: f64,
    pub force: [[f64; 3]; 6],
    /// ∂²W/∂x_a∂x_b.
    pub stiffness: [[[[f64; 3]; 3]; 6]; 6],
}

/// The wound faces of all windings, sorted by element.
pub(crate) fn wound_faces(mesh: &Mesh) -> Result<Vec<WoundFace>, FemError> {
    let mut wound = Vec::new();
    if mesh.windings().is_empty() {
        return Ok(wound);
    }
    let outer = outer_faces(mesh);
    let on = |list: &[usize], n: usize| list.binary_search(&n).is_ok();
    let of_chamber = |nodes: &[usize; 6]| {
        (mesh.chambers().iter()).any(|(_, list)| nodes.iter().all(|&n| on(list, n)))
    };
    for winding in mesh.windings() {
        let named = mesh.surface(&winding.surface);
        let mut threads = 0;
        for &(element, local) in &outer {
            let nodes = local.map(|k| mesh.tetrahedra()[element][k]);
            let x = nodes.map(|n| mesh.nodes_m()[n]);
            let belongs = match named {
                Some(list) => nodes.iter().all(|&n| on(list, n)),
                // All that looks away from the axis.
                None => looks_outside(&x) && !of_chamber(&nodes),
            };
            if belongs {
                let face = WoundFace {
                    element,
                    local,
                    threads: threads_on(&x, winding.angle_rad, winding.stiffness_N_m),
                };
                threads += face.threads.len();
                wound.push(face);
            }
        }
        if threads == 0 {
            return Err(FemError::Winding {
                surface: winding.surface.clone(),
            });
        }
    }
    wound.sort_by_key(|face| face.element);
    Ok(wound)
}

/// Whether a face looks away from the axis all over.
fn looks_outside(x: &[[f64; 3]; 6]) -> bool {
    let mut outside = true;
    surface::visit(x, |p| {
        let normal = cross(p.along[0], p.along[1]);
        outside &= dot(normal, [0.0, p.at[1], p.at[2]]) > 0.0;
    });
    outside
}

/// Threads at ±`angle` from the direction round x.
fn threads_on(x: &[[f64; 3]; 6], angle_rad: f64, stiffness_N_m: f64) -> Vec<Thread> {
    let mut threads = Vec::new();
    surface::visit(x, |p| {
        let [t1, t2] = p.along;
        let normal = cross(t1, t2);
        let area = norm(normal);
        let round = cross(normal, [1.0, 0.0, 0.0]);
        let size = norm(round);
        if size < LEAST_SLOPE * area {
            return;
        }
        let round = round.map(|v| v / size);
        let rise = cross(normal.map(|v| v / area), round);
        for angle in [angle_rad, -angle_rad] {
            let along: [f64; 3] =
                std::array::from_fn(|k| angle.cos() * round[k] + angle.sin() * rise[k]);
            // along = c₁ t₁ + c₂ t₂ in the tangent plane.
            let [g11, g12, g22] = [dot(t1, t1), dot(t1, t2), dot(t2, t2)];
            let (b1, b2) = (dot(along, t1), dot(along, t2));
            let det = g11 * g22 - g12 * g12;
            let (c1, c2) = ((g22 * b1 - g12 * b2) / det, (g11 * b2 - g12 * b1) / det);
            threads.push(Thread {
                slope: p.slope.map(|[d1, d2]| c1 * d1 + c2 * d2),
                weight_Nm: 0.5 * stiffness_N_m * p.weight * area,
            });
        }
    });
    threads
}

impl WoundFace {
    /// Energy, force and stiffness with its nodes at `x`.
    pub fn at(&self, x: &[[f64; 3]; 6]) -> FaceThreads {
        let mut sum = FaceThreads {
            energy_J: 0.0,
            force: [[0.0; 3]; 6],
            stiffness: [[[[0.0; 3]; 3]; 6]; 6],
        };
        for thread in &self.threads {
            let s = &thread.slope;
            let tangent: [f64; 3] =
                std::array::from_fn(|k| (0..6).map(|a| s[a] * x[a][k]).sum::<f64>());
            let stretch = norm(tangent);
            let unit = tangent.map(|v| v / stretch);
            let w = thread.weight_Nm;
            sum.energy_J += 0.5 * w * (stretch - 1.0).powi(2);
            for a in 0..6 {
                for i in 0..3 {
                    sum.force[a][i] += w * (stretch - 1.0) * s[a] * unit[i];
                    for b in 0..6 {
                        for k in 0..3 {
                            let same = f64::from(u8::from(i == k)) * (1.0 - 1.0 / stretch);
                            sum.stiffness[a][b][i][k] +=
                                w * s[a] * s[b] * (same + unit[i] * unit[k] / stretch);
                        }
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_and_stiffness_are_derivatives_of_the_energy() {
        let x = [
            [0.00, 1.00, 0.10],
            [0.50, 0.90, 0.50],
            [0.90, 1.10, 0.00],
            [0.25, 1.00, 0.30],
            [0.70, 1.02, 0.25],
            [0.45, 1.08, 0.02],
        ];
        let face = WoundFace {
            element: 0,
            local: [0; 6],
            threads: threads_on(&x, 0.4, 3.0),
        };
        assert_eq!(face.threads.len(), 12);
        assert!(face.at(&x).energy_J < 1e-25);
        let moved: [[f64; 3]; 6] = std::array::from_fn(|a| {
            std::array::from_fn(|k| x[a][k] + 0.03 * ((7 * a + 3 * k) as f64).sin())
        });
        let step = 1e-6;
        for b in 0..6 {
            for k in 0..3 {
                let at = |sign: f64| {
                    let mut y = moved;
                    y[b][k] += sign * step;
                    face.at(&y)
                };
                let (up, down, here) = (at(1.0), at(-1.0), face.at(&moved));
                let slope = (up.energy_J - down.energy_J) / (2.0 * step);
                assert!((slope - here.force[b][k]).abs() < 1e-8);
                for a in 0..6 {
                    for i in 0..3 {
                        let slope = (up.force[a][i] - down.force[a][i]) / (2.0 * step);
                        assert!((slope - here.stiffness[a][b][i][k]).abs() < 1e-7);
                    }
                }
            }
        }
    }
}
