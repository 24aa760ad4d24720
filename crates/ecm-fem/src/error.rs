//! Errors of the input. Failure to converge is a [`crate::Status`] instead.

use thiserror::Error;

/// A wrong mesh, material, load or file: place, value found and value expected.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum FemError {
    /// A material whose parameters do not fit its model.
    #[error("material {model:?}: {problem}")]
    Material {
        /// The model.
        model: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// A file that cannot be read at all.
    #[error("cannot read mesh file {path}: {reason}; check the path and its permissions")]
    Unreadable {
        /// The path as given.
        path: String,
        /// The system's message.
        reason: String,
    },
    /// A mesh file with invalid content.
    #[error("{path}, line {line}: found {found}, expected {expected}")]
    MeshFile {
        /// The path as given.
        path: String,
        /// One-based line.
        line: usize,
        /// Text found.
        found: String,
        /// Text expected, and the next step.
        expected: String,
    },
    /// A named face that the mesh does not have.
    #[error(
        "the mesh has no face named `{name}` (named groups: {found}); give the clamped face the \
         physical group `base` and the rigid one `top`"
    )]
    MissingFace {
        /// `base` or `top`.
        name: &'static str,
        /// The names in the mesh.
        found: String,
    },
    /// A named face that holds nodes but no element face.
    #[error(
        "face `{name}` holds {nodes} nodes but no whole face of a tetrahedron; a named group must \
         be a surface of the body"
    )]
    NotASurface {
        /// `base` or `top`.
        name: &'static str,
        /// How many nodes it holds.
        nodes: usize,
    },
    /// The two named faces share nodes.
    #[error("faces `base` and `top` share node {node}; they must be apart")]
    SharedNode {
        /// The first common node.
        node: usize,
    },
    /// A chamber that is none.
    #[error("chamber `{name}`: {problem}")]
    Chamber {
        /// Its name.
        name: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// A tendon that is none.
    #[error("tendon `{name}`: {problem}")]
    Tendon {
        /// Its name.
        name: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// A winding without a surface or region to lie on.
    #[error("winding on `{on}`: the mesh has no such {expected}")]
    Winding {
        /// Name of the surface or region.
        on: String,
        /// What it has to be, and the names of those that there are.
        expected: String,
    },
    /// An inverted or flat element.
    #[error(
        "{count} of {total} tetrahedra are inverted or flat, the first is {element} at \
         ({:.4}, {:.4}, {:.4}) m with Jacobian {jacobian:.3e} m^3; expected positive: check the \
         corner order, remesh, or make curved edges shorter",
        centre[0], centre[1], centre[2]
    )]
    InvertedElement {
        /// Index of the first one.
        element: usize,
        /// Smallest Jacobian determinant in it.
        jacobian: f64,
        /// Its centre.
        centre: [f64; 3],
        /// How many there are.
        count: usize,
        /// Elements in the mesh.
        total: usize,
    },
    /// A body of unconnected pieces.
    #[error(
        "the mesh falls into {pieces} unconnected pieces; the second begins at tetrahedron \
         {element} at ({:.4}, {:.4}, {:.4}) m: merge duplicate nodes or remove it",
        centre[0], centre[1], centre[2]
    )]
    Disconnected {
        /// Number of pieces.
        pieces: usize,
        /// First element outside the first piece.
        element: usize,
        /// Its centre.
        centre: [f64; 3],
    },
    /// Nodes that no element uses.
    #[error("{count} nodes belong to no tetrahedron, the first is {node}; remove them")]
    UnusedNode {
        /// The first one.
        node: usize,
        /// How many.
        count: usize,
    },
    /// A node that does not exist.
    #[error("{what} {index} names node {node}, but the mesh has {nodes} nodes")]
    NoSuchNode {
        /// `tetrahedron`, `base_nodes entry`, `top_nodes entry`.
        what: &'static str,
        /// Its index.
        index: usize,
        /// The node asked for.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A number that is NaN or infinite.
    #[error("{what} {index} is {value}; expected a finite number")]
    NotFinite {
        /// What holds it.
        what: &'static str,
        /// Its index.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A mesh that does not extend along +x.
    #[error(
        "the top face's centre is ({:.4}, {:.4}, {:.4}) m from the base's; expected (L, 0, 0): turn \
         the mesh so that x runs from base to top (files must be in metres)",
        offset[0], offset[1], offset[2]
    )]
    WrongAxis {
        /// Centre of `top` minus centre of `base`.
        offset: [f64; 3],
    },
    /// A parameter outside its range.
    #[error("{name} is {value}; expected {expected}")]
    Parameter {
        /// Its name with unit.
        name: &'static str,
        /// The value given.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A body that does not carry its own weight.
    #[error(
        "the body has no stable equilibrium without a load (status {status}): it does not carry its \
         own weight; check the density, the modulus in Pa and the direction of gravity"
    )]
    NoRest {
        /// Status of the load case without a wrench.
        status: &'static str,
    },
    /// Wrenches and poses in one batch.
    #[error("load {row} is a {found}, load 0 is a {first}; solve them in two batches")]
    MixedLoads {
        /// The first load of the other kind.
        row: usize,
        /// `wrench` or `pose`.
        found: &'static str,
        /// The kind of load 0.
        first: &'static str,
    },
    /// The cancel flag was set before there was a result.
    #[error("cancelled by the caller")]
    Cancelled,
    /// An unknown word.
    #[error("{name} is \"{value}\"; expected {expected}")]
    Word {
        /// Which option.
        name: &'static str,
        /// The word given.
        value: String,
        /// The words known.
        expected: &'static str,
    },
    /// An array of the wrong size.
    #[error("{what} has {found} entries; expected {expected}, {why}")]
    Size {
        /// Which array.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
        /// What that number stands for.
        why: &'static str,
    },
    /// The sparse solver could not allocate or analyse.
    #[error("sparse factorisation of {unknowns} unknowns failed: {reason}; use a coarser mesh")]
    Factorisation {
        /// Number of unknowns.
        unknowns: usize,
        /// The library's message.
        reason: String,
    },
}
