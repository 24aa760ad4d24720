"""The Rust core. Poses are (x, y, z, theta_x, theta_y, theta_z) in m and rad,
wrenches (fx, fy, fz, tau_x, tau_y, tau_z) in N and N m, both in base axes at the
top frame's origin (see docs/explain/mechanics.md). Arrays are float64, C order.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DWELLS_S",
    "Adapter",
    "DesignError",
    "DesignResult",
    "EcmError",
    "EnergyEvaluator",
    "Fem",
    "FemError",
    "FemResults",
    "Mesh",
    "ModelError",
    "PolynomialEvaluator",
    "Stepper",
    "WarmStart",
    "__version__",
    "check_rotations",
    "convert_stiffness",
    "criteria",
    "d_optimal",
    "diagnosable_visits",
    "export_model",
    "inverse_left_jacobians",
    "left_jacobians",
    "material_decode",
    "material_models",
    "material_moduli",
    "material_start",
    "material_stress",
    "maximin",
    "merged_triangle",
    "mid_frame",
    "open_model",
    "outer_poses",
    "polynomial_exponents",
    "polynomial_regressor",
    "repeated_rows",
    "rod_poses",
    "rod_wrenches",
    "rotation_matrices",
    "rotation_vectors",
    "row_list",
    "rows_inside",
    "seal_model",
]

_F = NDArray[np.float64]
_I = NDArray[np.int64]
_Progress = Callable[[int, int], object] | None
_StiffnessKind = Literal["partial", "generalised", "screw"]

__version__: str

class EcmError(Exception): ...
class FemError(EcmError): ...
class ModelError(EcmError): ...
class DesignError(EcmError): ...

# --- se3 ---------------------------------------------------------------
# Rows that are not finite, or so large that an angle has no digits left, give NaN.
def rotation_matrices(rotation_vectors: _F) -> _F:
    """exp of (N, 3) rotation vectors: (N, 3, 3); ModelError for one longer than pi."""

def rotation_vectors(rotation_matrices: _F) -> _F:
    """log of (N, 3, 3) rotations: (N, 3), |theta| <= pi; ModelError for a reflection."""

def check_rotations(rotation_vectors: _F) -> None:
    """ModelError, naming the row, where one of (N, 3) rotation vectors is longer than pi."""

def left_jacobians(rotation_vectors: _F) -> _F:
    """J(theta) with dphi = J dtheta: (N, 3, 3)."""

def inverse_left_jacobians(rotation_vectors: _F) -> _F:
    """J(theta)^-1 with dtheta = J^-1 dphi: (N, 3, 3)."""

def mid_frame(poses: _F, length_m: float) -> _F:
    """q = (c, theta) of (N, 6) poses: c = A' r - (L, 0, 0), A = exp(theta/2)."""

def convert_stiffness(
    stiffness: _F, poses: _F, wrenches: _F, *, source: _StiffnessKind, target: _StiffnessKind
) -> _F:
    """Between K = dh/dp, H = d(f, J' tau)/dp and K_s = K diag(_I, J^-1): (N, 6, 6)."""

# --- fem ---------------------------------------------------------------
@final
class Mesh:
    @staticmethod
    def cylinder(*, length_m: float, radius_m: float, quality: str = "standard") -> Mesh: ...
    @staticmethod
    def tube(
        *, length_m: float, radius_m: float, inner_radius_m: float, quality: str = "standard"
    ) -> Mesh: ...
    @staticmethod
    def hourglass(
        *, length_m: float, radius_m: float, waist_radius_m: float, quality: str = "standard"
    ) -> Mesh: ...
    @staticmethod
    def stacked_discs(
        *,
        length_m: float,
        radius_m: float,
        waist_radius_m: float,
        disc_count: int,
        quality: str = "standard",
    ) -> Mesh:
        """r(x) = waist + (radius - waist) cos^2(pi (discs - 1) x / L)."""
    @staticmethod
    def chambered(
        *,
        length_m: float,
        radius_m: float,
        chamber_count: int,
        chamber_inner_m: float,
        chamber_outer_m: float,
        chamber_angle_rad: float,
        channel_radius_m: float = 0.0,
        end_wall_m: float = 0.0,
        quality: str = "standard",
    ) -> Mesh:
        """Cylinder with chambers round its axis, the first towards y; angle 0: round ones."""
    def with_chamber(self, name: str, nodes: _I) -> Mesh:
        """With a closed chamber whose wall holds all of these nodes (n,)."""
    @property
    def chambers(self) -> list[tuple[str, _I]]:
        """Name and nodes of each chamber's wall."""
    def with_tendon(
        self,
        name: str,
        *,
        base_m: Sequence[Sequence[float]] = ...,
        body_m: Sequence[Sequence[float]] = ...,
        platform_m: Sequence[Sequence[float]] = ...,
    ) -> Mesh:
        """With a tendon, straight between points of the base, of the body, then of the platform."""
    def with_winding(
        self,
        on: str,
        *,
        angles_rad: Sequence[float],
        stiffness_N_m: float | None = None,
        stiffness_Pa: float | None = None,
    ) -> Mesh:
        """With threads bonded to a chamber's wall, another named surface or "outside" (N/m), or
        through a named region or "body" (Pa); two angles from the direction round it."""
    @staticmethod
    def from_arrays(nodes_m: _F, tetrahedra: _I, *, base_nodes: _I, top_nodes: _I) -> Mesh:
        """(N, 3) and (M, 10) arrays, node numbers of the two faces."""
    @staticmethod
    def read(path: str) -> Mesh:
        """Gmsh 4.1 ASCII with named faces `base` and `top`; linear or quadratic tetrahedra."""
    @property
    def nodes_m(self) -> _F: ...
    @property
    def tetrahedra(self) -> _I:
        """(M, 10), corner nodes then mid-edge nodes 01 12 02 03 13 23."""
    @property
    def base_nodes(self) -> _I: ...
    @property
    def top_nodes(self) -> _I: ...
    @property
    def length_m(self) -> float:
        """Distance of the centres of the two named faces."""
    @property
    def volume_m3(self) -> float: ...

@final
class FemResults:
    """One row per load case; rows that did not converge hold the last stable state, or nan where
    there is none."""
    @property
    def status(self) -> list[str]:
        """solved | unstable | not_converged | inverted | collapsed | cancelled"""
    @property
    def poses(self) -> _F: ...
    @property
    def wrenches(self) -> _F: ...
    @property
    def loads(self) -> _F:
        """(N, 6 + m): wrench and inputs (pressures, Pa, then tensions, N), as the solver takes them."""
    @property
    def amounts(self) -> _F:
        """(N, m): change of each chamber's volume, m^3, then shortening of each tendon, m."""
    @property
    def actuation_jacobians(self) -> tuple[_F, _F]:
        """G = dh/da, (N, 6, m), and C = dq/da, (N, m, m), at fixed pose and other inputs."""
    @property
    def energy_J(self) -> _F: ...
    @property
    def stiffness(self) -> _F:
        """K = dh/dp, (N, 6, 6)."""
    @property
    def hessian(self) -> _F:
        """H = d(f, J' tau)/dp, (N, 6, 6), symmetric."""
    @property
    def reason(self) -> list[str]:
        """Why a case is unstable (buckling, crease, inner); empty for all others."""
    @property
    def stretch_ratio(self) -> _F:
        """Smallest ratio of the smallest to the largest principal stretch."""
    @property
    def smallest_stretch(self) -> _F:
        """Smallest principal stretch; compressed surfaces of neo-Hookean bodies crease below 0.65."""
    @property
    def determinant(self) -> _F:
        """Determinant of the screw stiffness K_s with lengths over L, (N m)^6; positive where the
        platform is stable under a dead wrench."""
    @property
    def smallest_eigenvalue(self) -> _F:
        """Smallest eigenvalue of the symmetric part of K_s with lengths over L, N m."""
    @property
    def largest_stretch(self) -> _F: ...
    @property
    def smallest_jacobian(self) -> _F: ...
    @property
    def iterations(self) -> _I: ...
    @property
    def residual(self) -> _F: ...
    @property
    def fields(self) -> NDArray[np.float32]:
        """(N, M) states for Fem.fit_warm_start; empty but after solve_each."""

@final
class WarmStart:
    """Warm start: initial guesses of states, fitted by Fem.fit_warm_start."""
    def __new__(cls, data: bytes) -> WarmStart: ...
    def to_bytes(self) -> bytes: ...

@final
class Fem:
    def __new__(
        cls,
        mesh: Mesh,
        *,
        young_modulus_Pa: float | None = None,
        poisson_ratio: float | None = None,
        model: str | None = None,
        parameters: Mapping[str, float | list[float]] | None = None,
        element_modulus_scale: _F | None = None,
        body_force_N_m3: tuple[float, float, float] | None = None,
        element: Literal["P2/P1", "P2/P0", "P2"] = "P2/P1",
    ) -> Fem:
        """Body clamped at `base`, rigid platform on `top`.
        model: neo_hookean (default), mooney_rivlin, yeoh, ogden, gent with their parameters
        (docs/fem.md). element_modulus_scale: (M,) factor on the moduli per tetrahedron.
        body_force_N_m3: density times gravity, base axes."""
    def write_vtu(
        self,
        path: str,
        *,
        wrench: Sequence[float] | None = None,
        pose: Sequence[float] | None = None,
        actuation: Sequence[float] | None = None,
    ) -> FemResults:
        """Solves one load and writes displacement, stretch, stress for ParaView."""
    @property
    def actuators(self) -> list[str]:
        """Names of the actuators in the order of their inputs: the chambers, then the tendons."""
    def rest_stiffness(self) -> _F: ...
    def solve_wrenches(
        self,
        wrenches: _F,
        *,
        given: Sequence[bool] | None = None,
        threads: int = 0,
        progress: _Progress = None,
    ) -> FemResults:
        """Equilibria under wrenches (N, 6), or (N, 6 + m) with an input per actuator: Pa, then N.
        given (m,): of which of them the amount stands there, m^3 and m."""
    def solve_each(
        self,
        wrenches: _F,
        *,
        warm_start: WarmStart | None = None,
        threads: int = 0,
        progress: _Progress = None,
        finished: Callable[[list[int], FemResults], object] | None = None,
    ) -> FemResults:
        """As solve_wrenches, but each case on its own from `warm_start`, or from rest.
        finished(rows, results) is called within 0.1 s of the end of each case."""
    def predict_poses(self, wrenches: _F, warm_start: WarmStart) -> _F:
        """Poses (N, 6) that a warm start predicts; nothing is solved."""
    def fit_warm_start(self, wrenches: _F, fields: NDArray[np.float32]) -> WarmStart | None:
        """A warm start fitted to states and their wrenches; None when there are too few."""
    def solve_poses(
        self,
        poses: _F,
        *,
        given: Sequence[bool] | None = None,
        threads: int = 0,
        progress: _Progress = None,
    ) -> FemResults:
        """Wrenches that hold poses (N, 6), or (N, 6 + m) as in solve_wrenches."""

def rod_poses(
    wrenches: _F,
    *,
    length_m: float,
    axial_stiffness_N: float,
    shear_stiffness_N: float,
    bending_stiffness_Nm2: float,
    torsion_stiffness_Nm2: float,
) -> tuple[_F, NDArray[np.bool_]]:
    """Cosserat rod clamped at its base under a dead tip wrench: poses (N, 6), converged (N,)."""

def rod_wrenches(
    poses: _F,
    start: _F,
    *,
    length_m: float,
    axial_stiffness_N: float,
    shear_stiffness_N: float,
    bending_stiffness_Nm2: float,
    torsion_stiffness_Nm2: float,
) -> tuple[_F, _F]:
    """Dead wrenches (N, 6) that hold the tip at poses, and d pose / d wrench (N, 6, 6); NaN where
    there is no equilibrium. `start` (N, 6): a first guess of the wrenches."""

# --- poly --------------------------------------------------------------
def polynomial_exponents(n_inputs: int, degree: int) -> _I:
    """(k, n_inputs), k = C(degree + n_inputs, degree), in the order of the paper's eq. (4)."""

def merged_triangle(triangles: Sequence[_F]) -> _F:
    """(c, c) triangle of the rows of several triangles."""

def polynomial_regressor(inputs: _F, degree: int, lower: _F, upper: _F) -> _F:
    """(N, k) regressor of inputs mapped from [lower, upper] to [-1, 1]."""

@final
class PolynomialEvaluator:
    """n inputs to m outputs; the paper's map has n = m = 6."""
    @staticmethod
    def fit(
        inputs: _F,
        outputs: _F,
        degree: int,
        *,
        method: Literal["least_squares", "ridge", "pcr"] = "least_squares",
        threshold: float = 0.0,
        ridge: float = 0.0,
        weights: _F | None = None,
    ) -> PolynomialEvaluator:
        """threshold: PCR drops singular values of the normalised, un-centred regressor below it."""
    @staticmethod
    def from_coefficients(
        degree: int, lower: _F, upper: _F, coefficients: _F
    ) -> PolynomialEvaluator: ...
    @staticmethod
    def triangle(inputs: _F, outputs: _F, degree: int, lower: _F, upper: _F) -> _F:
        """(c, c) triangle of [regressor | outputs] of some of the rows of `fit_triangles`."""
    @staticmethod
    def fit_triangles(
        triangles: Sequence[_F], rows: int, degree: int, lower: _F, upper: _F
    ) -> PolynomialEvaluator:
        """Least squares of the rows of several triangles, `rows` in all."""
    @staticmethod
    def condition_number_raw(inputs: _F, degree: int) -> float:
        """kappa of the regressor without normalisation."""
    @staticmethod
    def leave_one_out(inputs: _F, outputs: _F, degree: int) -> tuple[_F, _F]:
        """Singular values (r,), and leave-one-out RMSE (r, m) of keeping the first 1, 2, ... r."""
    def leverage(self, inputs: _F) -> _F:
        """(N,) variance of the prediction in units of the residual variance."""
    def prediction_sd(self, inputs: _F) -> _F:
        """(N, m) standard deviation of a new measurement around the prediction."""
    def predict(self, inputs: _F, turns: bool = False) -> _F:
        """(N, m). turns: the last three inputs are a rotation vector, of at most pi."""
    def jacobian(self, inputs: _F, turns: bool = False) -> _F:
        """(N, m, n); K = dh/dp for the paper's map."""
    def document(self, inputs: Sequence[str], outputs: Sequence[str]) -> dict[str, Any]:
        """The map's part of a model file, with these column names."""
    @property
    def degree(self) -> int: ...
    @property
    def coefficients(self) -> _F:
        """(k, m), of the normalised inputs, outputs in their own unit."""
    @property
    def lower(self) -> _F: ...
    @property
    def upper(self) -> _F: ...
    @property
    def condition_number(self) -> float:
        """kappa of the normalised regressor that was kept (after PCR)."""
    @property
    def rank(self) -> int: ...
    @property
    def unscaled_covariance(self) -> _F:
        """(k, k) covariance of the coefficients of an output in units of its residual variance."""
    @property
    def residual_variance(self) -> _F:
        """(m,) residual square per degree of freedom; NaN where it was not fitted."""

@final
class EnergyEvaluator:
    """U(q) in mid-frame coordinates; Q = dU/dq; h by inverting conventions' two lines."""
    @staticmethod
    def fit(
        poses: _F,
        wrenches: _F,
        *,
        length_m: float,
        degree: int,
        symmetry: Literal["alike", "revolution", "general"] = "alike",
        covariance: _F | None = None,
        groups: Sequence[str] = ...,
    ) -> EnergyEvaluator:
        """covariance: (N, 6, 6) of each row's wrench; without it the components are weighted
        by the spread of each. groups: broken symmetries, unlike_ends, handedness, precurvature,
        face_tilt, anisotropy."""
    @staticmethod
    def scale_of(poses: _F, length_m: float) -> _F:
        """(2,) length and angle that a fit to these poses makes dimensionless with."""
    @staticmethod
    def triangle(
        poses: _F,
        wrenches: _F,
        covariance: _F,
        *,
        length_m: float,
        degree: int,
        symmetry: Literal["alike", "revolution", "general"],
        scale: _F,
        groups: Sequence[str] = ...,
    ) -> _F:
        """(c, c) triangle of the whitened [regressor | wrenches] of some of the rows of
        `fit_triangles`."""
    @staticmethod
    def fit_triangles(
        triangles: Sequence[_F],
        rows: int,
        *,
        length_m: float,
        degree: int,
        symmetry: Literal["alike", "revolution", "general"],
        scale: _F,
        groups: Sequence[str] = ...,
    ) -> EnergyEvaluator:
        """The fit of several triangles, which stand for `rows` poses."""
    @staticmethod
    def from_coefficients(
        *,
        length_m: float,
        degree: int,
        symmetry: Literal["alike", "revolution", "general"],
        scale: _F,
        coefficients: _F,
        groups: Sequence[str] = ...,
    ) -> EnergyEvaluator: ...
    @staticmethod
    def regressor(
        poses: _F,
        *,
        length_m: float,
        degree: int,
        symmetry: Literal["alike", "revolution", "general"],
        scale: _F,
        groups: Sequence[str] = ...,
    ) -> _F:
        """(N, 6, k): h = regressor @ coefficients."""
    def document(self) -> dict[str, Any]:
        """The map's part of a model file."""
    @property
    def name(self) -> str:
        """`energyD`, then `-revolution` or `-general`, then `+group` for each group."""
    def energy_J(self, poses: _F) -> _F: ...
    def predict(self, poses: _F) -> _F: ...
    def stiffness(self, poses: _F, kind: _StiffnessKind = "partial") -> _F: ...
    def wrench_and_stiffness(self, poses: _F, kind: _StiffnessKind = "partial") -> tuple[_F, _F]:
        """(N, 6) and (N, 6, 6) in one call; a single pose has the path of a controller."""
    def prediction_covariance(self, poses: _F) -> _F:
        """(N, 6, 6) of the predicted wrench, of the coefficients' covariance."""
    @property
    def rank(self) -> int: ...
    @property
    def condition_number(self) -> float:
        """kappa of the whitened, column-scaled regressor; NaN where it was not fitted."""
    @property
    def residual_variance(self) -> float:
        """Whitened residual square per degree of freedom: 1 where the covariance is right."""
    @property
    def coefficients(self) -> _F: ...
    @property
    def covariance(self) -> _F:
        """(k, k) of the coefficients."""
    @property
    def terms(self) -> _I:
        """(k, 6) exponents of c_x, |c_perp|^2, |theta_perp|^2, theta_x, a, b; general: of c, theta."""
    @property
    def group_terms(self) -> _I:
        """(g, 7) powers of c_x, theta_x, C = c_y + i c_z, C*, D = -theta_z + i theta_y, D*, and
        0 for the real part or 1 for the imaginary one; their coefficients follow those of terms."""
    @property
    def groups(self) -> list[str]:
        """Names of the broken symmetries."""
    @property
    def scale(self) -> _F:
        """(2,) length and angle that make the coordinates dimensionless."""
    @property
    def length_m(self) -> float: ...
    @property
    def degree(self) -> int: ...
    @property
    def symmetry(self) -> str: ...

def seal_model(document: str) -> str:
    """A model document (JSON text) checked, and sealed with its sha256."""

def open_model(text: str) -> dict[str, Any]:
    """The document of a model file; ModelError when its sum, version, kind or a range is wrong."""

def export_model(
    text: str,
    name: str,
    *,
    target: Literal["c", "rust"],
    precision: Literal["double", "single"] = "double",
    effects: str | None = None,
    adapt: str | None = None,
) -> dict[str, str]:
    """Source files by path: C with golden vectors, or a const Rust crate.

    effects: JSON of effects of time, exported as steps with a state; others stay out.
    """

@final
class Stepper:
    """A model file's map with effects of time (JSON), and the state of one mechanism."""

    state: _F | None
    """(49,) plain numbers; None before `init`."""

    def __new__(cls, text: str, effects: str) -> Stepper: ...
    def init(self, pose: _F) -> bool:
        """Whether the pose has a finite wrench; else the state stays."""

    def step(
        self, pose: _F, dt: float, temperature_degc: float, age_s: float
    ) -> tuple[_F, _F] | None:
        """Wrench (6,) and tangent (6, 6); None, and the state stays, where it is refused."""

    def predict_ahead(
        self, poses: _F, dt: float, temperature_degc: float, age_s: float
    ) -> tuple[_F, _F]:
        """Wrenches (n, 6), tangents (n, 6, 6) of the poses before one that is refused."""

    def inputs_inside(self, temperature_degc: float, age_s: float) -> bool:
        """Whether both are in the ranges for which the model was measured."""

    def settled(self, pose: _F, temperature_degc: float, age_s: float) -> tuple[_F, _F] | None:
        """Wrench (6,) and stiffness (6, 6) after a long rest; None where the pose is refused."""

@final
class Adapter:
    """A model file's map with effects of time (JSON), whose parameters follow readings."""

    state: _F
    """Numbers of the estimate and of the mechanism."""

    def __new__(cls, text: str, effects: str, settings: str) -> Adapter: ...
    def reset(self) -> None:
        """Back to the start."""

    def resume(self) -> None:
        """Goes on after a diagnosis."""

    def observe(
        self, pose: _F, wrench: _F, dt: float, temperature_degc: float, age_s: float
    ) -> tuple[int, _F, _F]:
        """Outcome, wrench (6,) that the robot feels, stiffness (6, 6)."""

    def follow(
        self, poses: _F, wrenches: _F, dts: _F, every: int
    ) -> tuple[_F, _F, _F, NDArray[np.uint8]]:
        """Readings expected (N, 6); parameters, standard deviations (M, 13); outcomes (N,)."""

    @property
    def values(self) -> _F:
        """(13,) parameters."""

    @property
    def covariance(self) -> _F:
        """(13, 13)."""

    @property
    def held(self) -> NDArray[np.bool_]:
        """(13,) whether a parameter is held for want of excitation."""

# --- material ----------------------------------------------------------
_Parameters = Mapping[str, float | Sequence[float]]

def material_models() -> list[tuple[str, list[str], bool]]:
    """Name, own parameters and whether these are lists of terms, of every material model."""

def material_moduli(model: str, named: _Parameters) -> tuple[float, float]:
    """Shear and bulk modulus at small strain, Pa."""

def material_stress(model: str, named: _Parameters, test: str, stretches: _F) -> _F:
    """Force per undeformed area, Pa, of the solid that keeps its volume: (N,) of stretches."""

def material_start(model: str, shear_modulus_Pa: float, terms: int) -> _F:
    """Free variables of a fit for a solid with this shear modulus."""

def material_decode(model: str, free: _F) -> _F:
    """Parameters, one after the other, of free variables."""

# --- doe ---------------------------------------------------------------
def criteria() -> list[tuple[str, str, bool]]:
    """Name, meaning and whether it averages over a region, of every criterion."""

@final
class DesignResult:
    @property
    def indices(self) -> _I:
        """Rows of the candidates, sorted."""
    @property
    def value(self) -> float:
        """log det(M/n)/k, the average or largest variance, or the smallest distance."""
    @property
    def bound(self) -> float:
        """Certified bound of `value` for any design of this size: upper, for i, a and g lower."""
    @property
    def efficiency(self) -> float:
        """exp(value - bound), bound / value, or value / bound."""
    @property
    def exchanges(self) -> int: ...
    @property
    def status(self) -> str:
        """converged | budget | interrupted"""

def d_optimal(
    regressor: _F,
    n: int,
    *,
    rows_per_pose: int = 1,
    starts: int = 10,
    iterations: int = 0,
    seed: int = 0,
    threads: int = 0,
    time_limit_s: float = 0.0,
    include: _I | None = None,
    replicates: bool = False,
    progress: _Progress = None,
    method: Literal["search", "fedorov", "rowwise"] = "search",
    exclude: _I | None = None,
    measured: _F | None = None,
    criterion: str = "d",
    prior: _F | None = None,
    share: float = 0.5,
    region: _F | None = None,
) -> DesignResult:
    """regressor: (N * rows_per_pose, k). iterations 0: the default budget. n counts the
    included rows, not the measured regressor rows (any number, k). prior: (k, k) prior
    information. criterion i, a: value is the average variance of the rows of region (by
    default the candidates'), or the summed variance of the coefficients, in noise variances;
    smaller is better.
    """

DWELLS_S: list[float]

def diagnosable_visits(
    poses: _F, dwells_s: Sequence[float], orders: Sequence[Sequence[int]]
) -> list[tuple[str, str, int, int, float]]:
    """Kind, action, pose, pose from which it is approached (-1: the initial pose) and rest (s) of
    each visit of poses (m, 6), in random orders of the poses, of the poses, of the visits and of
    their rests.
    """

def outer_poses(poses: _F) -> list[int]:
    """For each pose (m, 6) the nearest one from which it is approached from outside, or -1."""

def row_list(text: str, count: int) -> list[int]:
    """Rows (from 0) of a list like `1,5-9`, which counts from 1, of a table of `count` rows."""

def rows_inside(text: str, names: Sequence[str], values: _F) -> list[int]:
    """Rows (from 0) of values (N, d) inside a region like `x_m<0.09&y_m>0` of the d names."""

def repeated_rows(points: _F, include: Sequence[int], exclude: Sequence[int]) -> list[int]:
    """Rows of points (N, d) with the coordinates of an earlier one, or of an included one."""

def maximin(
    points: _F,
    n: int,
    *,
    method: Literal["exchange", "search"] = "search",
    starts: int = 10,
    iterations: int = 0,
    seed: int = 0,
    threads: int = 0,
    time_limit_s: float = 0.0,
    include: _I | None = None,
    progress: _Progress = None,
    exclude: _I | None = None,
    measured: _F | None = None,
) -> DesignResult:
    """Distances of the points as given: scale the columns to [-1, 1] beforehand."""
