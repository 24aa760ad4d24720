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
use crate::material::Material;
use crate::mesh::Mesh;
use crate::pattern::{ENTRIES, NONE, Pattern};
use crate::tensor::{Mat3, cofactor};

/// Shape functions per element, padded so that loops over them run in vector registers.
const PAD: usize = 12;

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
    /// Points of element e at `e * rule.points().len() ..`.
    pub points: Vec<Point>,
    /// p = `pressure_unit_Pa` × unknown.
    pub pressure_unit_Pa: f64,
    /// Dead force by displacement component, N.
    pub dead_force_N: Vec<f64>,
}

/// Displacements (3 per node, m) and scaled pressures (one per node, used at corners).
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
            points,
            pressure_unit_Pa,
            dead_force_N,
        }
    }

    /// Sets the dead force to ∫ N_a b dV for a force `b` per undeformed volume, N/m³.
    pub fn set_body_force(&mut self, b: [f64; 3]) {
        self.dead_force_N.fill(0.0);
        let rule = self.rule.points();
        for (e, tet) in self.mesh.tetrahedra().iter().enumerate() {
            let points = &self.points[e * rule.len()..(e + 1) * rule.len()];
            for (point, (lambda, _)) in points.iter().zip(rule) {
                for (n, node) in tet10::shape(lambda).iter().zip(tet) {
                    for k in 0..3 {
                        self.dead_force_N[3 * node + k] += point.volume_m3 * n * b[k];
                    }
                }
            }
        }
    }

    /// The undeformed state.
    pub fn rest(&self) -> Field {
        let n = self.mesh.nodes_m().len();
        Field {
            displacement: vec![0.0; 3 * n],
            pressure: vec![0.0; n],
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
        let shapes = self.rule.points().iter();
        self.deformation_gradients(e, field)
            .zip(shapes)
            .map(|(f, (psi, _))| {
                let jacobian = crate::tensor::determinant(&f);
                let scaled: f64 = (0..4).map(|m| psi[m] * field.pressure[tet[m]]).sum();
                let stress = self.material.respond(&f, jacobian).stress;
                let mut sigma = crate::tensor::product(&stress, &crate::tensor::transpose(&f))
                    .map(|row| row.map(|v| v * self.modulus_scale[e] / jacobian));
                for k in 0..3 {
                    sigma[k][k] += self.pressure_unit_Pa * scaled;
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
            *force = -dead;
        }
        self.volume.fill(0.0);
        self.coupling.fill([0.0; 6]);
        self.platform = [[0.0; 6]; 6];
        self.energy_J = 0.0;
        self.smallest_jacobian = f64::INFINITY;
        let mut element = Element::default();
        for (e, tet) in body.mesh.tetrahedra().iter().enumerate() {
            element.evaluate(body, e, field)?;
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

fn element_displacement(tet: &[usize; 10], field: &Field) -> [[f64; PAD]; 3] {
    let mut u = [[0.0; PAD]; 3];
    for a in 0..10 {
        for i in 0..3 {
            u[i][a] = field.displacement[3 * tet[a] + i];
        }
    }
    u
}

#[inline(always)]
fn deformation(point: &Point, u: &[[f64; PAD]; 3]) -> Mat3 {
    let mut f = crate::tensor::IDENTITY;
    for i in 0..3 {
        for j in 0..3 {
            let mut sum = 0.0;
            for a in 0..PAD {
                sum += u[i][a] * point.gradients[j][a];
            }
            f[i][j] += sum;
        }
    }
    f
}

/// Forces and matrix of one element.
#[derive(Debug, Default)]
struct Element {
    energy: f64,
    smallest_jacobian: f64,
    /// By component, then node.
    force: [[f64; PAD]; 3],
    volume: [f64; 4],
    /// `[a][i][k][b]`, valid for b ≥ 4 ⌊a / 4⌋.
    stiffness: [[[[f64; PAD]; 3]; 3]; 10],
    /// `[m][i][a]`.
    mixed: [[[f64; PAD]; 3]; 4],
    compliance: [[f64; 4]; 4],
}

impl Element {
    #[inline(never)]
    fn evaluate(&mut self, body: &Body, e: usize, field: &Field) -> Result<(), Inverted> {
        *self = Self {
            smallest_jacobian: f64::INFINITY,
            ..Self::default()
        };
        let tet = &body.mesh.tetrahedra()[e];
        let u = element_displacement(tet, field);
        let scale = body.modulus_scale[e];
        let unit = body.pressure_unit_Pa;
        let by_kappa = unit / (body.material.bulk_modulus_Pa() * scale);
        let corner_pressure: [f64; 4] = std::array::from_fn(|m| field.pressure[tet[m]]);
        let rule = body.rule.points();
        let points = &body.points[e * rule.len()..(e + 1) * rule.len()];
        for (point, (psi, _)) in points.iter().zip(rule) {
            let f = deformation(point, &u);
            let cof = cofactor(&f);
            let jacobian = f[0][0] * cof[0][0] + f[0][1] * cof[0][1] + f[0][2] * cof[0][2];
            if jacobian.is_nan() || jacobian <= 0.0 {
                return Err(Inverted);
            }
            self.smallest_jacobian = self.smallest_jacobian.min(jacobian);
            let weight = point.volume_m3;
            let scaled: f64 = (0..4).map(|m| psi[m] * corner_pressure[m]).sum();
            let p = unit * scaled;
            let mut response = body.material.respond(&f, jacobian);
            let distortion = weight * scale;
            self.energy += distortion * response.energy
                + weight * p * (jacobian - 1.0 - 0.5 * by_kappa * scaled);
            // Weighted stress and tangent with the pressure's part.
            let wp = weight * p;
            for i in 0..3 {
                for j in 0..3 {
                    let stress = distortion * response.stress[i][j] + wp * cof[i][j];
                    for a in 0..PAD {
                        self.force[i][a] += stress * point.gradients[j][a];
                    }
                }
            }
            for row in &mut response.tangent {
                for value in row {
                    *value *= distortion;
                }
            }
            add_cofactor_tangent(&mut response.tangent, &f, wp);
            self.add_stiffness(&response.tangent, &point.gradients);
            let mut spread = [[0.0; PAD]; 3];
            for i in 0..3 {
                for j in 0..3 {
                    for a in 0..PAD {
                        spread[i][a] += cof[i][j] * point.gradients[j][a];
                    }
                }
            }
            let gap = jacobian - 1.0 - by_kappa * scaled;
            for m in 0..4 {
                let c = weight * unit * psi[m];
                self.volume[m] += c * gap;
                for i in 0..3 {
                    for a in 0..PAD {
                        self.mixed[m][i][a] += c * spread[i][a];
                    }
                }
                for n in 0..=m {
                    self.compliance[m][n] -= c * by_kappa * psi[n];
                }
            }
        }
        Ok(())
    }

    /// K_ab += g_a · A · g_b for b from the block of four that holds a.
    #[inline(always)]
    fn add_stiffness(&mut self, tangent: &[[f64; 9]; 9], g: &[[f64; PAD]; 3]) {
        // half[J][i][k][b] = Σ_L A_iJkL g_b,L
        let mut half = [[[[0.0; PAD]; 3]; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                for k in 0..3 {
                    let row = &tangent[3 * i + j][3 * k..3 * k + 3];
                    let out = &mut half[j][i][k];
                    for b in 0..PAD {
                        out[b] = row[0] * g[0][b] + row[1] * g[1][b] + row[2] * g[2][b];
                    }
                }
            }
        }
        for a in 0..10 {
            let (g0, g1, g2) = (g[0][a], g[1][a], g[2][a]);
            let start = a / 4 * 4;
            for i in 0..3 {
                for k in 0..3 {
                    let out = &mut self.stiffness[a][i][k][start..];
                    let (h0, h1, h2) = (
                        &half[0][i][k][start..],
                        &half[1][i][k][start..],
                        &half[2][i][k][start..],
                    );
                    for b in 0..out.len() {
                        out[b] += g0 * h0[b] + g1 * h1[b] + g2 * h2[b];
                    }
                }
            }
        }
    }

    /// Adds the lower triangle in the order of [`crate::pattern::entries`].
    #[inline(never)]
    fn scatter(&self, targets: &[u32], tangent: &mut [f64]) {
        let mut at = targets.iter();
        let mut add = |value: f64| {
            if let Some(&target) = at.next()
                && let Some(entry) = tangent.get_mut(target as usize)
            {
                *entry += value;
            }
        };
        for a in 0..10 {
            for i in 0..3 {
                for k in i..3 {
                    add(self.stiffness[a][i][k][a]);
                }
                for b in a + 1..10 {
                    for k in 0..3 {
                        add(self.stiffness[a][i][k][b]);
                    }
                }
            }
        }
        for m in 0..4 {
            for a in 0..10 {
                for i in 0..3 {
                    add(self.mixed[m][i][a]);
                }
            }
        }
        for m in 0..4 {
            for n in 0..=m {
                add(self.compliance[m][n]);
            }
        }
    }

    /// Entry of the 34 × 34 matrix with a displacement column.
    fn entry(&self, row: usize, column: usize) -> f64 {
        if row >= 30 {
            return self.mixed[row - 30][column % 3][column / 3];
        }
        let (a, b) = (row.min(column), row.max(column));
        self.stiffness[a / 3][a % 3][b % 3][b / 3]
    }
}

/// A_iJkL += p ∂(cof F)_iJ/∂F_kL = p ε_ikm ε_JLN F_mN.
#[inline(always)]
fn add_cofactor_tangent(tangent: &mut [[f64; 9]; 9], f: &Mat3, p: f64) {
    for i in 0..3 {
        let (k1, k2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (l1, l2) = ((j + 1) % 3, (j + 2) % 3);
            let row = &mut tangent[3 * i + j];
            // ε_i,k1,k2 = +1 with m the remaining index.
            row[3 * k1 + l1] += p * f[k2][l2];
            row[3 * k1 + l2] -= p * f[k2][l1];
            row[3 * k2 + l1] -= p * f[k1][l2];
            row[3 * k2 + l2] += p * f[k1][l1];
        }
    }
}
