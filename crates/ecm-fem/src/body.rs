//! The body to be deformed: mesh, material and quadrature points, and its state as a field.

use crate::FemError;
use crate::chamber::Chambers;
use crate::element::{Rule, tet10};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::platform::Platform;
use crate::tendon::Tendons;
use crate::tensor::Mat3;
use crate::winding::{Wound, wound};

/// Shape functions per element, padded so that loops over them run in vector registers.
pub(crate) const PAD: usize = 12;

/// How the pressure is represented; all with quadratic displacements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
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
#[non_exhaustive]
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
    /// Closed chambers, one actuator each.
    pub(crate) chambers: Chambers,
    /// Tendons, one actuator each, behind the chambers.
    pub(crate) tendons: Tendons,
    /// Faces and elements with threads, sorted by element.
    pub(crate) wound: Vec<Wound>,
}

/// Displacements (3 per node, m) and scaled pressures: P2/P1 one per node, used at corners;
/// P2/P0 one per element; P2 one per quadrature point (condensed).
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Displacement component `3 node + i`, m.
    pub displacement: Vec<f64>,
    /// Pressure / `pressure_unit_Pa`.
    pub pressure: Vec<f64>,
}

/// An element of the trial state is inverted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inverted;

impl Body {
    /// Precomputes gradients and scales.
    pub(crate) fn new(
        mesh: Mesh,
        material: Box<dyn Material>,
        modulus_scale: Vec<f64>,
        rule: Rule,
        formulation: Formulation,
        tendons: Tendons,
    ) -> Result<Self, FemError> {
        let chambers = Chambers::new(&mesh)?;
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
        let wound = wound(&mesh, rule)?;
        let size = (mesh.volume_m3() / mesh.tetrahedra().len() as f64).cbrt();
        let pressure_unit_Pa = material.shear_modulus_Pa() / size;
        let dead_force_N = vec![0.0; 3 * mesh.nodes_m().len()];
        Ok(Self {
            mesh,
            material,
            modulus_scale,
            rule,
            formulation,
            points,
            pressure_unit_Pa,
            dead_force_N,
            chambers,
            tendons,
            wound,
        })
    }

    /// Place of a node in a state.
    pub(crate) fn place_m(&self, field: &Field, node: usize) -> [f64; 3] {
        let x = self.mesh.nodes_m()[node];
        [0, 1, 2].map(|k| x[k] + field.displacement[3 * node + k])
    }

    /// Number of actuators: chambers, then tendons.
    pub(crate) fn actuators(&self) -> usize {
        self.chambers.count() + self.tendons.count()
    }

    /// Amount of each actuator: volume of a chamber, m³, and minus the length of a tendon, m.
    pub(crate) fn amounts(&self, field: &Field, platform: &Platform) -> Vec<f64> {
        let at = |node| self.place_m(field, node);
        let mut amounts = self.chambers.volumes_m3(&self.mesh, at, platform);
        let lengths = self.tendons.lengths_m(at, platform);
        amounts.extend(lengths.into_iter().map(|length| -length));
        amounts
    }

    /// Condensed pressures per element; 0 where the pressure is an unknown.
    pub(crate) fn condensed_pressures(&self) -> usize {
        match self.formulation {
            Formulation::TaylorHood => 0,
            Formulation::ConstantPressure => 1,
            Formulation::Displacement => self.rule.points().len(),
        }
    }

    /// The undeformed state.
    pub fn rest(&self) -> Field {
        let n = self.mesh.nodes_m().len();
        let pressures = match self.condensed_pressures() {
            0 => n,
            condensed => condensed * self.mesh.tetrahedra().len(),
        };
        Field {
            displacement: vec![0.0; 3 * n],
            pressure: vec![0.0; pressures],
        }
    }

    /// Deformation gradients at the points of element `e`.
    pub(crate) fn deformation_gradients<'a>(
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

/// Displacements of the nodes of one tetrahedron, by component, then node.
pub(crate) fn element_displacement(tet: &[usize; 10], field: &Field) -> [[f64; PAD]; 3] {
    let mut u = [[0.0; PAD]; 3];
    for a in 0..10 {
        for i in 0..3 {
            u[i][a] = field.displacement[3 * tet[a] + i];
        }
    }
    u
}

/// Deformation gradient at one point.
#[inline(always)]
pub(crate) fn deformation(point: &Point, u: &[[f64; PAD]; 3]) -> Mat3 {
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
