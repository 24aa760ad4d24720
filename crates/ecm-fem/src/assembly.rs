//! From a state to its internal forces and tangent, element by element.
//!
//! With the gradients g_a of the shape functions in the undeformed body, the
//! pressure shapes ψ_m (linear) and cof F = J F^-T:
//!
//! r_a = ∫ (P_d + p cof F) g_a, r_m = ∫ ψ_m (J − 1 − p/κ),
//! K_ab = ∫ g_a · (A_d + p ∂cof F/∂F) · g_b, K_am = ∫ ψ_m cof F g_a, K_mn = −∫ ψ_m ψ_n / κ.
//!
//! The unknown pressure is p divided by `pressure_unit_Pa`, so that all blocks have
//! one size; unscaled, static pivoting stalls Newton at 1e-8.

use crate::element::{Rule, tet10};
use crate::kernel::{Element, deformation, element_displacement};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::pattern::{ENTRIES, NONE, Pattern};
use crate::tensor::Mat3;

/// Shape functions per element, padded so that loops over them run in vector registers.
pub(crate) const PAD: usize = 12;

/// How the pressure is represented; all with quadratic displacements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Formulation {
    /// P2/P1: continuous, linear, an unknown at every corner.
    #[default]
    TaylorHood,
    /// P2/P0: constant per element and eliminated, p = κ (mean J − 1). Errs on the soft
    /// side where Taylor–Hood errs on the stiff side: together they bracket.
    ConstantPressure,
    /// P2: p = κ (J − 1) at each point, the element of peers (C3D10); locks near ν = 0.5.
    Displacement,
}

/// One quadrature point of one element.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// g_a by component, then shape function.
    pub gradients: [[f64; PAD]; 3],
    /// Weight times Jacobian determinant, m³.
    pub volume_m3: f64,
}

/// What does not change during a solve.
#[derive(Debug)]
pub struct Body {
    /// The mesh.
    pub mesh: Mesh,
    /// The material.
    pub material: Box<dyn Material>,
    /// Factor on all moduli, per element.
    pub modulus_scale: Vec<f64>,
    /// Quadrature rule.
    pub rule: Rule,
    /// Treatment of the pressure.
    pub formulation: Formulation,
    /// Points of element e at `e * rule.points().len() ..`.
    pub points: Vec<Point>,
    /// p = `pressure_unit_Pa` × unknown.
    pub pressure_unit_Pa: f64,
    /// Dead force by displacement component, N.
    pub dead_force_N: Vec<f64>,
}

/// Displacements (3 per node, m) and scaled pressures: P2/P1 one per node, used at corners;
/// P2/P0 one per element; P2 one per quadrature point (see [`crate::inner_pressure`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Displacement component `3 node + i`, m.
    pub displacement: Vec<f64>,
    /// Pressure / `pressure_unit_Pa`.
    pub pressure: Vec<f64>,
}

/// Sums of one pass over the elements; reused without allocation.
#[derive(Debug)]
pub struct Sums {
    /// Lower triangle of the tangent in the order of the pattern.
    pub tangent: Vec<f64>,
    /// Internal less dead force by displacement component, N.
    pub force: Vec<f64>,
    /// Residual of the pressure equation per node, in N (scaled).
    pub volume: Vec<f64>,
    /// ∂(force on unknowns)/∂(platform translation, rotation), row per unknown.
    pub coupling: Vec<[f64; 6]>,
    /// ∂(wrench)/∂(platform translation, rotation) without the geometric term.
    pub platform: [[f64; 6]; 6],
    /// Share of the body's dead force that acts; 1 but on the way to a load.
    pub dead_share: f64,
    /// Softness of kept pressures in the tangent, 0 near a solution (see `inner_pressure`).
    pub softening: f64,
    /// Stored energy, J.
    pub energy_J: f64,
    /// Smallest det F.
    pub smallest_jacobian: f64,
}

/// An element of the trial state is inverted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inverted;

impl Body {
    /// Precomputes gradients and scales.
    pub fn new(
        mesh: Mesh,
        material: Box<dyn Material>,
        modulus_scale: Vec<f64>,
        rule: Rule,
        formulation: Formulation,
    ) -> Self {
        let mut points = Vec::with_capacity(mesh.tetrahedra().len() * rule.points().len());
        for tet in mesh.tetrahedra() {
            let x = tet.map(|i| mesh.nodes_m()[i]);
            for (lambda, weight) in rule.points() {
                let (g, det) = tet10::gradients(&x, lambda);
                let mut gradients = [[0.0; PAD]; 3];
                for a in 0..10 {
                    for k in 0..3 {
                        gradients[k][a] = g[a][k];
                    }
                }
                points.push(Point {
                    gradients,
                    volume_m3: weight * det,
                });
            }
        }
        let size = (mesh.volume_m3() / mesh.tetrahedra().len() as f64).cbrt();
        let pressure_unit_Pa = material.shear_modulus_Pa() / size;
        let dead_force_N = vec![0.0; 3 * mesh.nodes_m().len()];
        Self {
            mesh,
            material,
            modulus_scale,
            rule,
            formulation,
            points,
            pressure_unit_Pa,
            dead_force_N,
        }
    }

    /// The undeformed state.
    pub fn rest(&self) -> Field {
        let n = self.mesh.nodes_m().len();
        let pressures = match self.kept_pressures() {
            0 => n,
            kept => kept * self.mesh.tetrahedra().len(),
        };
        Field {
            displacement: vec![0.0; 3 * n],
            pressure: vec![0.0; pressures],
        }
    }

    /// Deformation gradients at the points of element `e`.
    pub fn deformation_gradients<'a>(
        &'a self,
        e: usize,
        field: &Field,
    ) -> impl Iterator<Item = Mat3> + 'a {
        let u = element_displacement(&self.mesh.tetrahedra()[e], field);
        let count = self.rule.points().len();
        self.points[e * count..(e + 1) * count]
            .iter()
            .map(move |point| deformation(point, &u))
    }
}

impl Body {
    /// Cauchy stress σ = P Fᵀ / J at the points of element `e`, Pa, with P of W_d and pressure.
    pub fn cauchy_stress_Pa(&self, e: usize, field: &Field) -> Vec<Mat3> {
        let tet = &self.mesh.tetrahedra()[e];
        let gradients: Vec<Mat3> = self.deformation_gradients(e, field).collect();
        let kept = self.kept_pressures();
        gradients
            .iter()
            .zip(self.rule.points())
            .enumerate()
            .map(|(q, (f, (psi, _)))| {
                let jacobian = crate::tensor::determinant(f);
                let scaled: f64 = match self.formulation {
                    Formulation::TaylorHood => {
                        (0..4).map(|m| psi[m] * field.pressure[tet[m]]).sum()
                    }
                    Formulation::ConstantPressure => field.pressure[e],
                    Formulation::Displacement => field.pressure[e * kept + q],
                };
                let pressure = self.pressure_unit_Pa * scaled;
                let mut stress = self.material.respond(f, jacobian).stress;
                let at_point = self.at_point(e, f, jacobian, pressure);
                for i in 0..3 {
                    for j in 0..3 {
                        stress[i][j] *= self.modulus_scale[e];
                        stress[i][j] += at_point.as_ref().map_or(0.0, |x| x.stress[i][j]);
                    }
                }
                let mut sigma = crate::tensor::product(&stress, &crate::tensor::transpose(f))
                    .map(|row| row.map(|v| v / jacobian));
                for k in 0..3 {
                    sigma[k][k] += pressure + at_point.as_ref().map_or(0.0, |x| x.pressure);
                }
                sigma
            })
            .collect()
    }
}

impl Sums {
    /// Memory for one pass.
    pub fn new(body: &Body, pattern: &Pattern) -> Self {
        let n = body.mesh.nodes_m().len();
        Self {
            tangent: vec![0.0; pattern.symbolic.entries()],
            force: vec![0.0; 3 * n],
            volume: vec![0.0; n],
            coupling: vec![[0.0; 6]; pattern.unknowns],
            platform: [[0.0; 6]; 6],
            dead_share: 1.0,
            softening: 0.0,
            energy_J: 0.0,
            smallest_jacobian: f64::INFINITY,
        }
    }

    /// Forces and tangent at `field`; `arm(node)` is the vector from the platform's
    /// origin to a platform node.
    ///
    /// # Errors
    /// [`Inverted`] when det F ≤ 0 at a quadrature point.
    pub fn assemble(
        &mut self,
        body: &Body,
        pattern: &Pattern,
        field: &Field,
        arm: impl Fn(usize) -> [f64; 3],
    ) -> Result<(), Inverted> {
        self.tangent.fill(0.0);
        for (force, dead) in self.force.iter_mut().zip(&body.dead_force_N) {
            *force = -self.dead_share * dead;
        }
        self.volume.fill(0.0);
        self.coupling.fill([0.0; 6]);
        self.platform = [[0.0; 6]; 6];
        self.energy_J = 0.0;
        self.smallest_jacobian = f64::INFINITY;
        let mut element = Element::default();
        for (e, tet) in body.mesh.tetrahedra().iter().enumerate() {
            element.evaluate(body, e, field, self.softening)?;
            self.energy_J += element.energy;
            self.smallest_jacobian = self.smallest_jacobian.min(element.smallest_jacobian);
            for a in 0..10 {
                for i in 0..3 {
                    self.force[3 * tet[a] + i] += element.force[i][a];
                }
            }
            for m in 0..4 {
                self.volume[tet[m]] += element.volume[m];
            }
            element.scatter(
                &pattern.scatter[e * ENTRIES..(e + 1) * ENTRIES],
                &mut self.tangent,
            );
            if pattern.touches_platform[e] {
                self.couple(pattern, &element, tet, &arm);
            }
        }
        Ok(())
    }

    /// Columns of the element matrix that belong to platform nodes, times
    /// δx = δr + δφ × arm.
    fn couple(
        &mut self,
        pattern: &Pattern,
        element: &Element,
        tet: &[usize; 10],
        arm: &impl Fn(usize) -> [f64; 3],
    ) {
        let held: [Option<[f64; 3]>; 10] = std::array::from_fn(|a| {
            pattern
                .platform_nodes
                .binary_search(&tet[a])
                .is_ok()
                .then(|| arm(tet[a]))
        });
        for row in 0..34 {
            let mut by_platform = [0.0; 6];
            for b in 0..10 {
                let Some(d) = held[b] else { continue };
                let k: [f64; 3] = std::array::from_fn(|j| element.entry(row, 3 * b + j));
                for j in 0..3 {
                    by_platform[j] += k[j];
                }
                // k · (δφ × d) = δφ · (d × k)
                let turn = crate::tensor::cross(d, k);
                for j in 0..3 {
                    by_platform[3 + j] += turn[j];
                }
            }
            let unknown = if row < 30 {
                pattern.of_displacement[3 * tet[row / 3] + row % 3]
            } else {
                pattern.of_pressure[tet[row - 30]]
            };
            if unknown != NONE {
                let target = &mut self.coupling[unknown as usize];
                for j in 0..6 {
                    target[j] += by_platform[j];
                }
            }
            if row < 30
                && let Some(d) = held[row / 3]
            {
                let i = row % 3;
                let mut axis = [0.0; 3];
                axis[i] = 1.0;
                let turn = crate::tensor::cross(d, axis);
                for j in 0..6 {
                    self.platform[i][j] += by_platform[j];
                    for k in 0..3 {
                        self.platform[3 + k][j] += turn[k] * by_platform[j];
                    }
                }
            }
        }
    }
}
