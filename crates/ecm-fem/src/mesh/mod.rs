//! Meshes of ten-node tetrahedra with two named faces.

mod chambered;
mod check;
mod gmsh;
mod profile;
mod quadratic;
mod revolve;
pub(crate) mod surface;

pub use chambered::{ChamberShape, Chambered};
pub use profile::Profile;
pub use revolve::Quality;

use crate::FemError;
use std::path::Path;

/// Edges of a tetrahedron in the order of its mid-edge nodes 4..10.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// Faces of a tetrahedron, outward: corners, then mid-edge nodes.
pub const FACES: [[usize; 6]; 4] = [
    [0, 2, 1, 6, 5, 4],
    [0, 1, 3, 4, 8, 7],
    [1, 2, 3, 5, 9, 8],
    [0, 3, 2, 7, 9, 6],
];

/// A checked body: every element right side out, one piece, both faces there,
/// base centre at the origin and top centre at (L, 0, 0).
#[derive(Debug, Clone)]
pub struct Mesh {
    nodes_m: Vec<[f64; 3]>,
    tetrahedra: Vec<[usize; 10]>,
    base_nodes: Vec<usize>,
    top_nodes: Vec<usize>,
    length_m: f64,
    volume_m3: f64,
    /// Name and sorted nodes of each chamber's wall.
    chambers: Vec<(String, Vec<usize>)>,
    /// Name and sorted nodes of other surfaces, for windings.
    surfaces: Vec<(String, Vec<usize>)>,
    /// Name and tetrahedra of each region.
    regions: Vec<(String, Vec<usize>)>,
    tendons: Vec<Tendon>,
    windings: Vec<Winding>,
}

/// The surface of [`Mesh::with_winding`] that looks away from the axis, chambers left out.
pub const OUTSIDE: &str = "outside";

/// The region of [`Mesh::with_winding`] that is the whole body, where no other has this name.
pub const BODY: &str = "body";

/// A thread that is pulled: straight between points of the base, then of the body, then of the
/// platform, all in the undeformed body in the base frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tendon {
    /// Its name.
    pub name: String,
    /// Points that the base carries, m.
    pub base_m: Vec<[f64; 3]>,
    /// Points within the body, m.
    pub body_m: Vec<[f64; 3]>,
    /// Points that the platform carries, m.
    pub platform_m: Vec<[f64; 3]>,
}

/// Threads bonded to a surface or through a region, at two angles from the direction round it.
#[derive(Debug, Clone, PartialEq)]
pub struct Winding {
    /// Name of a chamber or of another surface of the mesh, or [`OUTSIDE`]; or of a region, or [`BODY`].
    pub on: String,
    /// Angles of the two families from the direction round it, rad; 0: rings. A positive one is a
    /// right-handed screw.
    pub angles_rad: [f64; 2],
    /// Whether `on` is a surface or a region, and how stiff the threads are.
    pub laid: Laid,
}

/// What the threads of a winding lie on, with the stiffness of both families together.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Laid {
    /// On a surface.
    OnSurface {
        /// E A of a thread over the distance of the threads, N/m.
        stiffness_N_m: f64,
    },
    /// All through a region.
    InRegion {
        /// E of the threads times their share of the volume, Pa.
        stiffness_Pa: f64,
    },
}

impl Winding {
    /// The mesh has no such place for it.
    pub(crate) fn nowhere(&self, mesh: &Mesh) -> FemError {
        let (what, all, named) = match self.laid {
            Laid::OnSurface { .. } => (
                "surface with faces along x",
                OUTSIDE,
                [&mesh.chambers[..], &mesh.surfaces],
            ),
            Laid::InRegion { .. } => ("region", BODY, [&mesh.regions[..], &[]]),
        };
        let named = named.into_iter().flatten();
        let names: String = named.map(|(name, _)| format!("{name}, ")).collect();
        FemError::Winding {
            on: self.on.clone(),
            expected: format!("{what}; it has {names}{all}"),
        }
    }
}

impl Mesh {
    /// Checks a mesh and moves it so that the centre of its base is the origin.
    ///
    /// `nodes_m`: N × 3; `tetrahedra`: corners, then mid-edge nodes 01 12 02 03
    /// 13 23; the two node lists hold all nodes of the clamped and the rigid face.
    ///
    /// # Errors
    /// [`FemError`] naming the first thing that is wrong.
    pub fn new(
        nodes_m: Vec<[f64; 3]>,
        tetrahedra: Vec<[usize; 10]>,
        base_nodes: Vec<usize>,
        top_nodes: Vec<usize>,
    ) -> Result<Self, FemError> {
        let mut mesh = Self {
            nodes_m,
            tetrahedra,
            base_nodes,
            top_nodes,
            length_m: 0.0,
            volume_m3: 0.0,
            chambers: Vec::new(),
            surfaces: Vec::new(),
            regions: Vec::new(),
            tendons: Vec::new(),
            windings: Vec::new(),
        };
        if mesh.has_no_faces() {
            return Err(FemError::MissingFace {
                name: "base",
                found: "none with nodes".into(),
            });
        }
        mesh.check()?;
        mesh.place()?;
        Ok(mesh)
    }

    /// A body without platform, left where it is; `length_m` only scales residuals.
    ///
    /// # Errors
    /// As [`Mesh::new`], but for the faces; a length that is not positive.
    pub fn without_faces(
        nodes_m: Vec<[f64; 3]>,
        tetrahedra: Vec<[usize; 10]>,
        length_m: f64,
    ) -> Result<Self, FemError> {
        if !(length_m.is_finite() && length_m > 0.0) {
            return Err(FemError::Parameter {
                name: "length_m",
                value: length_m,
                expected: "a positive length in metres",
            });
        }
        Self::in_place(nodes_m, tetrahedra, Vec::new(), Vec::new(), length_m)
    }

    /// Straight-edged ten-node tetrahedra from corners: mid-edge nodes are added to `nodes_m`.
    ///
    /// # Errors
    /// A corner that is no node.
    pub fn with_mid_nodes(
        nodes_m: &mut Vec<[f64; 3]>,
        corners: &[[usize; 4]],
    ) -> Result<Vec<[usize; 10]>, FemError> {
        let nodes = nodes_m.len();
        for (index, &node) in corners.iter().flatten().enumerate() {
            if node >= nodes {
                return Err(FemError::NoSuchNode {
                    what: "tetrahedron",
                    index: index / 4,
                    node,
                    nodes,
                });
            }
        }
        Ok(quadratic::raise(nodes_m, corners, |a, b, x| {
            [0, 1, 2].map(|k| 0.5 * (x[a][k] + x[b][k]))
        }))
    }

    /// As [`Mesh::new`] for a body that is built in place, `length_m` long to the last bit.
    fn in_place(
        nodes_m: Vec<[f64; 3]>,
        tetrahedra: Vec<[usize; 10]>,
        base_nodes: Vec<usize>,
        top_nodes: Vec<usize>,
        length_m: f64,
    ) -> Result<Self, FemError> {
        let mut mesh = Self {
            nodes_m,
            tetrahedra,
            base_nodes,
            top_nodes,
            length_m,
            volume_m3: 0.0,
            chambers: Vec::new(),
            surfaces: Vec::new(),
            regions: Vec::new(),
            tendons: Vec::new(),
            windings: Vec::new(),
        };
        mesh.check()?;
        Ok(mesh)
    }

    /// Neither face is there: a body that carries no platform.
    fn has_no_faces(&self) -> bool {
        self.base_nodes.is_empty() && self.top_nodes.is_empty()
    }

    fn check(&mut self) -> Result<(), FemError> {
        self.check_indices()?;
        self.base_nodes.sort_unstable();
        self.base_nodes.dedup();
        self.top_nodes.sort_unstable();
        self.top_nodes.dedup();
        self.volume_m3 = self.check_shape()?;
        Ok(())
    }

    /// A clamped cylinder along x.
    ///
    /// # Errors
    /// A length or radius that is not positive, or a radius below 2e-5 or above 1000 of the length.
    pub fn cylinder(length_m: f64, radius_m: f64, quality: Quality) -> Result<Self, FemError> {
        revolve::mesh(length_m, &Profile::Cylinder { radius_m }, quality)
    }

    /// A clamped tube along x.
    ///
    /// # Errors
    /// As [`Mesh::cylinder`]; an inner radius that is not positive, or that leaves a wall of less
    /// than 1 % of the radius or 1e-5 of the length.
    pub fn tube(
        length_m: f64,
        radius_m: f64,
        inner_radius_m: f64,
        quality: Quality,
    ) -> Result<Self, FemError> {
        revolve::mesh(
            length_m,
            &Profile::Tube {
                radius_m,
                inner_radius_m,
            },
            quality,
        )
    }

    /// A body of revolution with parabolic profile:
    /// r(x) = waist + (radius − waist)(2x/L − 1)².
    ///
    /// # Errors
    /// As [`Mesh::cylinder`], of both radii; a waist below 1 % or above 100 times the radius.
    pub fn hourglass(
        length_m: f64,
        radius_m: f64,
        waist_radius_m: f64,
        quality: Quality,
    ) -> Result<Self, FemError> {
        revolve::mesh(
            length_m,
            &Profile::Hourglass {
                radius_m,
                waist_radius_m,
            },
            quality,
        )
    }

    /// Discs with rounded waists: r(x) = waist + (radius − waist) cos²(π (discs − 1) x / L).
    ///
    /// # Errors
    /// As [`Mesh::hourglass`]; fewer than 2 or more than 40 discs.
    pub fn stacked_discs(
        length_m: f64,
        radius_m: f64,
        waist_radius_m: f64,
        discs: usize,
        quality: Quality,
    ) -> Result<Self, FemError> {
        let profile = Profile::StackedDiscs {
            radius_m,
            waist_radius_m,
            discs,
        };
        revolve::mesh(length_m, &profile, quality)
    }

    /// A Gmsh 4.1 ASCII file with physical groups `base` and `top`.
    ///
    /// # Errors
    /// A file that cannot be read, is malformed, or describes a broken mesh.
    pub fn read(path: &Path) -> Result<Self, FemError> {
        gmsh::read(path)
    }

    /// Node positions in the base frame, m.
    pub fn nodes_m(&self) -> &[[f64; 3]] {
        &self.nodes_m
    }

    /// Corner nodes then mid-edge nodes 01 12 02 03 13 23.
    pub fn tetrahedra(&self) -> &[[usize; 10]] {
        &self.tetrahedra
    }

    /// Nodes of the clamped face, sorted.
    pub fn base_nodes(&self) -> &[usize] {
        &self.base_nodes
    }

    /// Nodes of the rigid face, sorted.
    pub fn top_nodes(&self) -> &[usize] {
        &self.top_nodes
    }

    /// With a closed chamber whose wall holds all of `nodes`; at the base and at the platform a rigid
    /// cap closes it.
    ///
    /// # Errors
    /// A node that does not exist; a name that is taken.
    pub fn with_chamber(mut self, name: &str, nodes: Vec<usize>) -> Result<Self, FemError> {
        let nodes = self.checked_nodes("chamber entry", nodes)?;
        if self.chambers.iter().any(|(known, _)| known == name) {
            return Err(FemError::Chamber {
                name: name.into(),
                problem: "two chambers have this name".into(),
            });
        }
        self.chambers.push((name.into(), nodes));
        Ok(self)
    }

    /// With a name for a surface that holds all of `nodes`, for a winding.
    ///
    /// # Errors
    /// A node that does not exist.
    pub fn with_surface(mut self, name: &str, nodes: Vec<usize>) -> Result<Self, FemError> {
        let nodes = self.checked_nodes("surface entry", nodes)?;
        self.surfaces.push((name.into(), nodes));
        Ok(self)
    }

    /// With a tendon; tendons follow the chambers in the order of the actuators.
    ///
    /// # Errors
    /// A point that is not finite; a name that is taken.
    pub fn with_tendon(mut self, tendon: Tendon) -> Result<Self, FemError> {
        let refused = |problem: &str| FemError::Tendon {
            name: tendon.name.clone(),
            problem: problem.into(),
        };
        let points = [&tendon.base_m, &tendon.body_m, &tendon.platform_m];
        if points
            .iter()
            .copied()
            .flatten()
            .flatten()
            .any(|v| !v.is_finite())
        {
            return Err(refused("a point is not finite"));
        }
        if self.tendons.iter().any(|known| known.name == tendon.name) {
            return Err(refused("two tendons have this name"));
        }
        self.tendons.push(tendon);
        Ok(self)
    }

    /// With a name for a region, for a winding.
    ///
    /// # Errors
    /// A tetrahedron that does not exist.
    pub fn with_region(mut self, name: &str, tetrahedra: Vec<usize>) -> Result<Self, FemError> {
        let count = self.tetrahedra.len();
        if let Some(wrong) = tetrahedra.iter().find(|e| **e >= count) {
            return Err(FemError::Parameter {
                name: "a tetrahedron of a region",
                value: *wrong as f64,
                expected: "one of the mesh, counted from 0",
            });
        }
        self.regions.push((name.into(), tetrahedra));
        Ok(self)
    }

    /// With threads round a surface or through a region.
    ///
    /// # Errors
    /// No surface or region of that name; an angle beyond π/2; a stiffness that is not positive.
    pub fn with_winding(
        mut self,
        on: &str,
        angles_rad: [f64; 2],
        laid: Laid,
    ) -> Result<Self, FemError> {
        let on = on.into();
        let winding = Winding {
            on,
            angles_rad,
            laid,
        };
        let (there, name, k, expected) = match winding.laid {
            Laid::OnSurface { stiffness_N_m } => (
                winding.on == OUTSIDE || self.surface(&winding.on).is_some(),
                "the stiffness of a winding",
                stiffness_N_m,
                "a positive number in N/m",
            ),
            Laid::InRegion { stiffness_Pa } => (
                self.region(&winding.on).is_some(),
                "the stiffness of a winding in a region",
                stiffness_Pa,
                "a positive number in Pa",
            ),
        };
        if !there {
            return Err(winding.nowhere(&self));
        }
        let refused = |name, value, expected| {
            Err(FemError::Parameter {
                name,
                value,
                expected,
            })
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        for angle in winding.angles_rad {
            if !(-quarter..=quarter).contains(&angle) {
                let expected = "-pi / 2 to pi / 2, in rad";
                return refused("the angle of a winding", angle, expected);
            }
        }
        if !(k.is_finite() && k > 0.0) {
            return refused(name, k, expected);
        }
        self.windings.push(winding);
        Ok(self)
    }

    /// Tetrahedra of a named region.
    pub fn region(&self, name: &str) -> Option<Vec<usize>> {
        match self.regions.iter().find(|(known, _)| known == name) {
            Some((_, tetrahedra)) => Some(tetrahedra.clone()),
            None => (name == BODY).then(|| (0..self.tetrahedra.len()).collect()),
        }
    }

    fn checked_nodes(
        &self,
        what: &'static str,
        mut nodes: Vec<usize>,
    ) -> Result<Vec<usize>, FemError> {
        let count = self.nodes_m.len();
        if let Some((index, &node)) = nodes.iter().enumerate().find(|(_, n)| **n >= count) {
            return Err(FemError::NoSuchNode {
                what,
                index,
                node,
                nodes: count,
            });
        }
        nodes.sort_unstable();
        nodes.dedup();
        Ok(nodes)
    }

    /// Sorted nodes of a chamber's wall or of another named surface.
    pub fn surface(&self, name: &str) -> Option<&[usize]> {
        let mut all = self.chambers.iter().chain(&self.surfaces);
        all.find(|(known, _)| known == name)
            .map(|(_, nodes)| nodes.as_slice())
    }

    /// The tendons, in the order of the actuators behind the chambers.
    pub fn tendons(&self) -> &[Tendon] {
        &self.tendons
    }

    /// The windings.
    pub fn windings(&self) -> &[Winding] {
        &self.windings
    }

    /// Name and sorted nodes of each chamber's wall, in the order of the actuators.
    pub fn chambers(&self) -> &[(String, Vec<usize>)] {
        &self.chambers
    }

    /// Distance between the centres of the two faces.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Volume of the curved elements.
    pub fn volume_m3(&self) -> f64 {
        self.volume_m3
    }

    fn place(&mut self) -> Result<(), FemError> {
        let base = surface::centre(&self.nodes_m, &self.tetrahedra, &self.base_nodes).ok_or(
            FemError::NotASurface {
                name: "base",
                nodes: self.base_nodes.len(),
            },
        )?;
        let top = surface::centre(&self.nodes_m, &self.tetrahedra, &self.top_nodes).ok_or(
            FemError::NotASurface {
                name: "top",
                nodes: self.top_nodes.len(),
            },
        )?;
        let offset = [0, 1, 2].map(|k| top[k] - base[k]);
        // 1e-3: a millimetre per metre, more than meshing tolerance, less than a mistake.
        if offset[0] <= 0.0 || offset[1].hypot(offset[2]) > 1e-3 * offset[0] {
            return Err(FemError::WrongAxis { offset });
        }
        for node in &mut self.nodes_m {
            for k in 0..3 {
                node[k] -= base[k];
            }
        }
        self.length_m = offset[0];
        Ok(())
    }
}
