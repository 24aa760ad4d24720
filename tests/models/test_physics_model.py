"""The physics base: a family of energies in E, nu, L and D, its error, its refit, its cache.

The family of the neck itself is built by FEM once for all tests; the cache and the algebra are
tried on bodies in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ecm import _native
from ecm._native import EnergyEvaluator
from ecm.diagnosis import diagnose
from ecm.errors import InputError
from ecm.fem.simulate import fem_poses
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Material, Mechanism
from ecm.io.settings import read_toml
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, PhysicsModel, fit_model, load_model, physics_map, registry
from ecm.models.partial import MeasuredMap
from ecm.models.physics import build as physics_build
from ecm.models.physics import map as physics
from ecm.models.physics.body_fits import (
    LENGTH_M,
    SHEAR_MODULUS_PA,
    noise_whiteners,
    rod_like,
    spread_poses,
    workspace_poses,
)
from ecm.models.physics.build import BuildSettings, shape_of
from ecm.models.physics.family import PARAMETERS, compressibility, poisson_ratio
from ecm.models.physics.refit import physics_sentences, refit_physics
from ecm.workflow.app import steps
from support.models import reread
from support.neck import columns_of
from support.products import kept_arrays

NECK = Mechanism()
SMALL = BuildSettings(poses=30, test_poses=6)


@pytest.fixture(scope="module")
def neck(neck_physics: PhysicsMap) -> PhysicsMap:
    """By FEM, made once for all files."""
    return neck_physics


class ClosedForm:
    """Bodies whose coefficients are what the family can hold; counts how often it is solved."""

    def __init__(self) -> None:
        self.solved = 0
        self.fail_at: int | None = None
        terms = 65
        random = np.random.default_rng(4)
        self.slopes = 0.02 * random.uniform(-1.0, 1.0, (3, 3, terms))
        self.rest = _native.EnergyEvaluator.fit(
            *_neck_like(), length_m=LENGTH_M, degree=6, symmetry="alike"
        )

    def energy(self, s: float, x: float) -> _native.EnergyEvaluator:
        t = (s - compressibility(NECK.poisson_ratio)) / 0.2
        change = np.einsum("a,b,abk->k", [1.0, t, t * t], [1.0, x, x * x], self.slopes)
        return _native.EnergyEvaluator.from_coefficients(
            length_m=LENGTH_M,
            degree=6,
            symmetry="alike",
            scale=self.rest.scale,
            coefficients=self.rest.coefficients * np.exp(3.0 * x) * (1.0 + change),
        )

    def fem(self, s: float, x: float) -> SimpleNamespace:
        energy = self.energy(s, x)

        def solve_poses(poses: F, **_: object) -> SimpleNamespace:
            if self.fail_at == self.solved:
                raise KeyboardInterrupt
            self.solved += 1
            return SimpleNamespace(
                wrenches=energy.predict(poses),
                stiffness=energy.stiffness(poses),
                status=["solved"] * len(poses),
            )

        home = np.array([[LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0]])
        return SimpleNamespace(
            rest_stiffness=lambda: energy.stiffness(home)[0], solve_poses=solve_poses
        )


def _neck_like() -> tuple[F, F]:
    """Poses and wrenches of a linear body in mid-frame coordinates, as stiff as the neck."""
    rest = np.diag([24000.0, 3600.0, 3600.0, 4.0, 16.0, 16.0])
    rest[1, 5] = rest[5, 1] = -186.0
    rest[2, 4] = rest[4, 2] = 186.0
    poses = workspace_poses(rest, 200, seed=1)
    diagonal = [24000.0, 3600.0, 3600.0, 4.0, 6.4, 6.4]
    linear = _native.EnergyEvaluator.from_coefficients(
        length_m=LENGTH_M, degree=2, symmetry="alike", scale=np.ones(2),
        coefficients=0.5 * np.array([0.0, diagonal[0], diagonal[1], diagonal[4], diagonal[3]]),
    )  # fmt: skip
    return poses, linear.predict(poses)


@pytest.fixture(scope="module")
def bodies() -> ClosedForm:
    """Made once: the cache folder below belongs to them."""
    return ClosedForm()


@pytest.fixture
def closed_form(bodies: ClosedForm) -> Iterator[ClosedForm]:
    """The build solves bodies in closed form, in this test only: the neck is built by FEM."""
    made = SimpleNamespace(fem=bodies.fem, diameter_over_length=0.066 / LENGTH_M)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics_build, "_Bodies", lambda shape: made)
        patch.setattr(physics_build, "spread_poses", chosen_once)
        yield bodies


_CHOSEN: dict[tuple[object, ...], F] = {}


def chosen_once(rest: F, *of: object, **options: object) -> F:
    """The poses of the same body and options are the same: they take longer than all the rest."""
    key = (rest.round(6).tobytes(), *of, *options.items())
    if key not in _CHOSEN:
        _CHOSEN[key] = spread_poses(rest, *of, **options)  # type: ignore[arg-type]
    return _CHOSEN[key].copy()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache folder that the tests in closed form share."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def base(closed_form: ClosedForm, folder: Path) -> PhysicsMap:
    """The family of the closed form."""
    return physics_map(NECK, cache=folder, settings=SMALL)


def some_poses(count: int) -> F:
    """A body as stiff as the neck."""
    stiffness = np.diag([2.4e4, 3.6e3, 3.6e3, 4.0, 16.0, 16.0])
    return workspace_poses(stiffness, count, seed=9)


def test_a_family_gives_bodies_between_its_own_back(
    base: PhysicsMap, closed_form: ClosedForm
) -> None:
    assert base.family is not None
    assert (base.family.symmetry, base.family.degree) == ("alike", 6)
    assert np.all(base.family.error_over_noise < 1e-6)
    poses = some_poses(40)
    nu, x = 0.45, 0.03
    fixed = base.at(
        young_modulus_Pa=2.0 * SHEAR_MODULUS_PA * (1.0 + nu),
        poisson_ratio=nu,
        diameter_m=0.066 * np.exp(x),
    )
    wanted = closed_form.energy(compressibility(nu), x).predict(poses)
    np.testing.assert_allclose(fixed.predict(poses), wanted, rtol=0, atol=1e-6 * abs(wanted).max())
    # By dimension: half the modulus at twice the size is twice the force at twice the shift.
    body = dict(zip(PARAMETERS, [0.9e6, 0.47, LENGTH_M, 0.066], strict=True))
    double = {"young_modulus_Pa": 0.45e6, "length_m": 2 * LENGTH_M, "diameter_m": 0.132}
    large = base.at(**{**body, **double}).predict(poses * np.repeat([2.0, 1.0], 3))
    ratio = large / base.at(**body).predict(poses)
    np.testing.assert_allclose(ratio, np.tile(np.repeat([2.0, 4.0], 3), (40, 1)), rtol=1e-9)


def test_sensitivities_are_the_slopes_of_the_family(base: PhysicsMap) -> None:
    base = base.with_free(*PARAMETERS)
    base = base.with_coefficients(np.array([0.7e6, 0.46, 0.1025, 0.0668]))
    poses = some_poses(20)
    columns = base.columns(poses)
    assert base.values is not None
    for j, name in enumerate(PARAMETERS):
        value = base.values[name]
        step = 1e-5 * value
        up, down = (base.at(**{name: value + s * step}).predict(poses) for s in (1.0, -1.0))
        slope = (up - down) / (2.0 * step)
        np.testing.assert_allclose(columns[:, :, j], slope, rtol=0, atol=1e-7 * abs(slope).max())
    # What a controller takes is an ordinary native energy with the same wrench and stiffness.
    np.testing.assert_allclose(base.at().predict(poses), base.predict(poses), rtol=1e-12)
    np.testing.assert_allclose(base.at().stiffness(poses), base.stiffness(poses), rtol=1e-12)


def test_a_shape_is_built_once_whatever_its_size_and_modulus(
    base: PhysicsMap, closed_form: ClosedForm, folder: Path
) -> None:
    seen: list[tuple[int, int]] = []

    def show(done: int, total: int, _: str) -> None:
        seen.append((done, total))

    before = closed_form.solved
    again = physics_map(NECK, cache=folder, settings=SMALL)
    other = replace(NECK, young_modulus_Pa=0.9e6, length_m=0.2068, radius_m=0.066)
    scaled = physics_map(other, cache=folder, settings=SMALL)
    assert closed_form.solved == before
    poses = some_poses(5)
    np.testing.assert_array_equal(base.predict(poses), again.predict(poses))
    assert scaled.length_m == 0.2068
    assert scaled.mechanism["young_modulus_Pa"] == 0.9e6
    physics_map(replace(NECK, radius_m=0.034), cache=folder, settings=SMALL, progress=show)
    assert closed_form.solved == before + 14
    assert seen[-1] == (9 * SMALL.poses + 3 * SMALL.test_poses,) * 2
    with pytest.raises(InputError, match="needs a body"):
        physics_map(Mechanism(builtin="", young_modulus_Pa=0.0), cache=folder)


def test_an_interrupted_build_goes_on(
    base: PhysicsMap, closed_form: ClosedForm, tmp_path: Path
) -> None:
    body = replace(NECK, radius_m=0.0335)  # of the neck the package brings what the mesh makes
    before = closed_form.solved
    closed_form.fail_at = before + 5
    with pytest.raises(KeyboardInterrupt):
        physics_map(body, cache=tmp_path, settings=SMALL)
    closed_form.fail_at = None
    found = physics_map(body, cache=tmp_path, settings=SMALL)
    assert closed_form.solved == before + 14
    poses = some_poses(5)
    np.testing.assert_array_equal(found.predict(poses), base.predict(poses))
    # The parts of the build are gone; the family and the error of its mesh stay.
    mesh, left = sorted(tmp_path.iterdir())
    assert mesh.name.startswith("mesh-")
    mesh.write_text("[]")  # what cannot be read is computed again
    again = physics_map(body, cache=tmp_path, settings=SMALL)
    assert again.mesh is not None
    assert found.mesh is not None
    np.testing.assert_array_equal(again.mesh.coefficients, found.mesh.coefficients)
    left.write_text(left.read_text().replace('"degree": 6', '"degree": "six"'))
    assert physics._read(left) is None


def test_ends_that_differ_are_noticed(closed_form: ClosedForm, tmp_path: Path) -> None:
    wanted = EnergyEvaluator.from_coefficients(
        length_m=LENGTH_M, degree=4, symmetry="revolution", scale=np.array([0.04, 0.8]),
        coefficients=np.concatenate([[0.0, 20.0, 3.0, 2.0, 1.3, 0.4], np.full(22, 0.01)]),
    )  # fmt: skip
    plain = closed_form.energy
    closed_form.energy = lambda s, x: wanted  # type: ignore[method-assign]
    try:
        found = physics_map(NECK, cache=tmp_path, settings=SMALL)
    finally:
        closed_form.energy = plain  # type: ignore[method-assign]
    assert found.family is not None
    assert found.family.symmetry == "revolution"
    np.testing.assert_allclose(
        found.predict(some_poses(5)), wanted.predict(some_poses(5)), rtol=1e-5
    )


def test_bodies_keep_their_law_when_nu_changes() -> None:
    yeoh = Material("yeoh", {"c1_Pa": 1e5, "c2_Pa": 2e3, "c3_Pa": 50.0, "bulk_modulus_Pa": 1e7})
    other = physics_build.with_poisson_ratio(yeoh, 0.45)
    assert other.shear_modulus_Pa == yeoh.shear_modulus_Pa
    assert other.poisson_ratio == 0.45
    body = replace(NECK, material=yeoh, young_modulus_Pa=yeoh.young_modulus_Pa)
    same = replace(NECK, material=yeoh.scaled(2.0), young_modulus_Pa=2.0 * yeoh.young_modulus_Pa)
    assert shape_of(body).key() == shape_of(same).key() != shape_of(NECK).key()
    assert poisson_ratio(compressibility(0.37)) == pytest.approx(0.37, abs=1e-14)


def table_of(poses: F, wrenches: F) -> Table:
    instrument = {"pose_position_sd_m": 37e-6, "pose_rotation_sd_rad": 6e-4,
                  "force_sd_N": 0.3, "torque_sd_Nm": 0.010}  # fmt: skip
    meta = Meta.from_dict({"mechanism": NECK.to_dict(), "instrument": instrument}, "test")
    return Table(columns_of(poses, wrenches), meta, "pairs")


def by_fem(body: Mechanism, count: int, seed: int) -> tuple[F, F, F]:
    """Poses of the workspace that no build has seen, their wrenches and stiffness."""

    def solve() -> tuple[F, F, F]:
        fem = body.fem()
        poses = workspace_poses(fem.rest_stiffness(), count, seed=seed, margin=1.0)
        found = fem.solve_poses(poses)
        ok = np.array([status == "solved" for status in found.status])
        assert ok.mean() > 0.9
        return poses[ok], found.wrenches[ok], found.stiffness[ok]

    poses, wrenches, stiffness = kept_arrays((body.key(), count, seed), solve)
    return poses, wrenches, stiffness


def test_the_error_is_far_below_the_noise(neck: PhysicsMap) -> None:
    assert neck.family is not None
    assert np.all(neck.family.error_over_noise < 0.15)
    body = Mechanism(young_modulus_Pa=0.8e6, poisson_ratio=0.463, length_m=0.1055, radius_m=0.0322)
    poses, wrenches, stiffness = by_fem(body, 24, 101)
    fixed = neck.at(young_modulus_Pa=0.8e6, poisson_ratio=0.463, length_m=0.1055, diameter_m=0.0644)
    left = fixed.predict(poses) - wrenches
    white = np.einsum("nij,nj->ni", noise_whiteners(poses, stiffness), left)
    assert float(np.sqrt((white**2).mean())) < 0.15
    # The model of the wrong body is far off, so this could have failed.
    wrong = np.einsum(
        "nij,nj->ni", noise_whiteners(poses, stiffness), neck.predict(poses) - wrenches
    )
    assert float(np.sqrt((wrong**2).mean())) > 5.0
    skew = fixed.stiffness(poses, "generalised")
    np.testing.assert_allclose(skew, np.swapaxes(skew, 1, 2), atol=1e-12 * abs(skew).max())


@pytest.fixture(scope="module")
def fine_mesh() -> tuple[F, F]:
    """Poses and wrenches of the neck's fine mesh."""
    poses, wrenches, _ = by_fem(replace(NECK, quality="fine"), 24, 5)
    return poses, wrenches


def test_the_difference_of_two_meshes_belongs_to_the_base(
    neck: PhysicsMap, fine_mesh: tuple[F, F], tmp_path: Path
) -> None:
    poses, fine = fine_mesh
    standard = NECK.fem().solve_poses(poses).wrenches
    off = neck.error_columns(poses)[:, :, 0]
    wrong = np.sqrt(((off - (standard - fine)) ** 2).mean(axis=0))
    assert np.all(wrong < 0.1 * np.sqrt(((standard - fine) ** 2).mean(axis=0)))
    shares = neck.mesh_shares
    assert shares is not None
    assert 0.001 < shares["fx_N"] < 0.003 < shares["fy_N"] < 0.007
    # Wrenches of another rubber go with E, those of the body in another size with L^2.
    stiffer = neck.with_coefficients(neck.coefficients * np.array([2.0, 1.0]))
    np.testing.assert_allclose(stiffer.error_columns(poses)[:, :, 0], 2.0 * off, rtol=1e-12)
    double = replace(NECK, length_m=2 * 0.1034, radius_m=0.066)
    assert neck.mesh is not None
    assert neck.values is not None
    larger = neck.mesh.at({**neck.values, "length_m": double.length_m})
    moved = poses * np.repeat([2.0, 1.0], 3)
    np.testing.assert_allclose(
        larger.predict(moved), off * np.repeat([4.0, 8.0], 3), rtol=1e-9, atol=1e-9
    )
    assert shape_of(double).key() == shape_of(NECK).key()
    kept = reread(Model(base=neck), tmp_path).base
    np.testing.assert_array_equal(kept.error_columns(poses)[:, :, 0], off)
    forces = MeasuredMap(neck, WRENCH[:3])
    np.testing.assert_array_equal(forces.error_columns(poses)[:, :, 0], off[:, :3])
    said = [line for line in physics_sentences(neck, np.eye(2)) if "mesh" in line]
    assert said[0].startswith("error of the standard mesh against the fine one: fx +0.2%, fy +0.5%")


def test_what_the_mesh_makes_gets_no_name(neck: PhysicsMap, fine_mesh: tuple[F, F]) -> None:
    poses, wrenches = (np.tile(part, (4, 1)) for part in fine_mesh)
    random = np.random.default_rng(6)
    poses = poses + random.standard_normal(poses.shape) * np.repeat([37e-6, 4e-4], 3)
    wrenches = wrenches + random.standard_normal(poses.shape) * np.repeat([0.3, 0.010], 3)
    table = table_of(poses, wrenches)
    found = diagnose(Model(base=neck), table).to_dict()
    assert found["verdict"] == "none"
    assert found["base"]["mesh_error_over_noise"] > 0.4
    # Without it the same rows are given a cause that they do not have.
    assert diagnose(Model(base=replace(neck, mesh=None)), table).to_dict()["effects"]
    # An effect of the same body that is larger than what the mesh makes keeps its name.
    thicker = table_of(poses, wrenches + neck.sensitivity(poses, "diameter_m") * 0.02 * 0.066)
    assert diagnose(Model(base=neck), thicker).to_dict()["answer"] == [["diameter_error"]]


def test_a_rod_and_a_mesh_file_have_no_second_mesh(tmp_path: Path) -> None:
    rod = replace(NECK, builtin="rod")
    assert physics_build.mesh_difference(shape_of(rod), "alike") is None
    file = Mechanism(builtin="", length_m=0.1, mesh_file=tmp_path / "body.msh")
    assert physics_build.mesh_difference(file, "alike") is None


def test_modulus_and_poisson_ratio_come_back_with_their_errors(neck: PhysicsMap) -> None:
    truth = np.array([0.71e6, 0.475])
    poses, wrenches, _ = by_fem(Mechanism(young_modulus_Pa=truth[0], poisson_ratio=truth[1]), 30, 7)
    random = np.random.default_rng(0)
    off = []
    for _ in range(20):
        seen = poses + random.standard_normal(poses.shape) * np.repeat([37e-6, 6e-4], 3)
        read = wrenches + random.standard_normal(poses.shape) * np.repeat([0.3, 0.010], 3)
        found = refit_physics(neck, table_of(seen, read))
        assert found.covariance is not None
        sd = np.sqrt(np.diag(found.covariance))
        off.append((found.base.coefficients - truth) / sd)
    assert found.base.parameter_names == ("young_modulus_Pa", "poisson_ratio")
    assert sd[0] < 0.005 * truth[0]
    assert sd[1] < 0.005
    assert abs(found.covariance[0, 1]) < 0.9 * sd[0] * sd[1]
    rms = np.sqrt((np.array(off) ** 2).mean(axis=0))
    assert np.all((rms > 0.5) & (rms < 1.7)), rms
    fitted = fit_model(table_of(seen, read), PhysicsModel(base=neck))
    np.testing.assert_allclose(fitted.base.coefficients, found.base.coefficients, rtol=1e-9)
    assert isinstance(fitted.base, PhysicsMap)
    assert fitted.covariance is not None
    assert "E = 0.7" in physics_sentences(fitted.base, fitted.covariance)[0]


def test_a_thicker_body_is_named_and_another_nu_absorbed(neck: PhysicsMap) -> None:
    body = Mechanism(radius_m=1.01 * 0.033, poisson_ratio=0.475)
    poses, wrenches, _ = by_fem(body, 60, 11)
    random = np.random.default_rng(5)
    poses, wrenches = np.tile(poses, (3, 1)), np.tile(wrenches, (3, 1))
    poses += random.standard_normal(poses.shape) * np.repeat([37e-6, 6e-4], 3)
    wrenches += random.standard_normal(poses.shape) * np.repeat([0.3, 0.010], 3)
    found = diagnose(Model(base=neck), table_of(poses, wrenches)).to_dict()
    assert found["base"]["kind"] == "physics"
    assert found["base"]["error_over_noise"] < 0.15
    assert found["base"]["mesh_error"]["fy_N"] == pytest.approx(0.005, abs=0.002)
    # Less than the noise, but more than the error of the energy: what a small effect may hide in.
    assert found["base"]["error_over_noise"] < found["base"]["mesh_error_over_noise"] < 1.0
    assert found["answer"] == [["diameter_error"]]
    size = found["effects"][0]["parameters"]["relative_diameter"]
    assert abs(size["value"] - 0.01) < 4.0 * size["sd"] < 0.002
    reasons = {item["id"]: item["reason"] for item in found["not_testable"]}
    assert "absorbs it (100 %)" in reasons["compressibility"]


def test_no_refit_leaves_what_was_tabulated(neck: PhysicsMap) -> None:
    poses = workspace_poses(NECK.fem().rest_stiffness(), 40, seed=3, margin=1.0)
    assert neck.family is not None
    beyond = replace(neck.family, s_range=(-0.2, 0.3)).at(
        {**(neck.values or {}), "poisson_ratio": 0.507}
    )
    found = refit_physics(neck, table_of(poses, beyond.predict(poses)))
    assert found.base.coefficients[1] == pytest.approx(0.5, abs=1e-9)
    assert isinstance(found.base, PhysicsMap)
    assert found.covariance is not None
    said = physics_sentences(found.base, found.covariance)
    assert "poisson_ratio is at the limit of the model" in said
    # E is the best one for nu = 0.5, not that of the step that left the range.
    with pytest.raises(InputError, match="tabulated from"):
        neck.at(poisson_ratio=0.2)
    with pytest.raises(InputError, match="there are young_modulus_Pa"):
        neck.at(radius_m=0.03)


def test_a_file_brings_the_family_along(neck: PhysicsMap, tmp_path: Path) -> None:
    poses = workspace_poses(NECK.fem().rest_stiffness(), 30, seed=3, margin=1.0)
    wrenches = neck.at(young_modulus_Pa=0.6e6, poisson_ratio=0.48).predict(poses)
    fitted = fit_model(table_of(poses, wrenches), PhysicsModel(base=neck))
    again = reread(fitted, tmp_path)
    assert isinstance(again.base, PhysicsMap)
    np.testing.assert_array_equal(again.predict(poses), fitted.predict(poses))
    np.testing.assert_array_equal(again.base.columns(poses), fitted.base.columns(poses))
    np.testing.assert_allclose(again.base.coefficients, [0.6e6, 0.48], rtol=1e-6)
    document = fitted.document()
    document["family"]["table"] = document["family"]["table"][:2]
    registry.write_document(document, tmp_path / "wrong.json")
    with pytest.raises(InputError, match=r"family.table: found shape \(2, 3"):
        load_model(tmp_path / "wrong.json")


def test_a_rod_like_the_body_has_its_stiffness_at_rest() -> None:
    sections = {"axial_stiffness_N": 2000.0, "shear_stiffness_N": 600.0,
                "bending_stiffness_Nm2": 0.5, "torsion_stiffness_Nm2": 0.4}  # fmt: skip
    step = 1e-6 * np.eye(6)
    moved, ok = _native.rod_poses(step, length_m=0.1, **sections)
    assert ok.all()
    compliance = (moved - [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]) / 1e-6
    found = rod_like(np.linalg.inv(compliance.T), 0.1)
    for name, value in sections.items():
        assert found[name] == pytest.approx(value, rel=1e-4)


def test_the_family_of_the_neck_is_in_the_package_and_of_this_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If this fails, the FEM, its meshes or the poses have changed: run scripts/neck_family.py."""

    def build(*_given: object, **_named: object) -> None:
        raise AssertionError("the family is built, not read: run scripts/neck_family.py")

    monkeypatch.setattr(physics, "build_family", build)
    described = read_toml(Path(steps.__file__).parent / "demo" / "plan.toml")["mechanism"]
    brought = physics_map(Mechanism.from_dict(described, "the demo"), cache=tmp_path)
    poses, wrenches = fem_poses(NECK, 1, seed=3)
    assert not list(tmp_path.glob("physics-*"))
    difference = brought.predict(poses) - wrenches
    assert np.abs(difference / brought.own_error).max() < 6.0
