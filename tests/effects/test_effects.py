"""Effects: first-order forms of the catalogue, Jacobians, conservation, what they need."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ecm import _native
from ecm.effects import (
    Effect,
    EffectBase,
    Rows,
    all_effects,
    effect,
    effects_for,
    get_effect,
    register,
    unregister,
)
from ecm.effects.contact import BaseCompliance
from ecm.effects.frames import BaseFrameMisalignment, TipFrameMisalignment
from ecm.effects.friction import Hysteresis
from ecm.effects.load import Payload
from ecm.effects.material import Anisotropy, LengthError
from ecm.effects.sensor import FtsDrift, FtsOffset
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta, Scene
from ecm.io.table import Table
from support.campaigns import campaign, physics, workspace_poses
from support.full_table import full_table
from support.stand_in import L


@pytest.fixture(scope="module")
def rows() -> Rows:
    table = campaign()
    return Rows(table.select(np.arange(0, len(table), 5)), physics())


@pytest.fixture(scope="module")
def everything(rows: Rows) -> Rows:
    """The same rows with every column and key that an effect may need."""
    return Rows(full_table(), rows.base)


def rows_for(id: str, everything: Rows) -> Rows:
    """A pose of the camera excludes effects of the encoders, and the other way round."""
    if id != "led_occlusion":
        return everything
    seen = np.random.default_rng(6).integers(4, 9, len(everything)).astype(float)
    return Rows(everything.table.with_columns({"leds_visible": seen}), everything.base)


def cross(a: F, b: F) -> F:
    return np.cross(a, b)


CATALOGUE = (
    "stress_relaxation", "viscous_damping", "hysteresis", "mullins_softening", "permanent_set",
    "temperature_modulus", "thermal_expansion", "ageing", "anisotropy", "strain_stiffening",
    "compressibility", "pretension", "taper", "length_error", "diameter_error", "face_tilt",
    "pre_curvature", "base_compliance", "platform_slip", "contact_stop", "debonding", "own_weight",
    "payload", "cable_drag", "tendon_friction", "inertia", "fts_offset", "fts_drift",
    "fts_thermal_drift", "fts_gain", "fts_crosstalk", "fts_saturation", "fts_hysteresis",
    "fts_quantisation", "fts_frame", "base_frame_misalignment", "tip_frame_misalignment",
    "camera_scale", "marker_motion", "time_skew", "led_occlusion", "robot_compliance", "backlash",
    "joint_offset", "outliers", "heteroscedastic_noise", "pose_noise",
)  # fmt: skip


def test_every_id_of_the_catalogue_is_there_once_and_says_what_it_is() -> None:
    ids = [item.id for item in all_effects()]
    assert sorted(ids) == sorted(CATALOGUE)
    for item in all_effects():
        assert item.physics.endswith(".")
        assert item.signature
        assert item.rivals, f"{item.id} names no rival"
        assert set(item.rivals) <= set(CATALOGUE), item.id
        assert all(item.rivals.values())
        for parameter in item.parameters:
            assert parameter.unit
            assert parameter.scale > 0.0
            assert parameter.lower <= 0.0 < parameter.upper


@pytest.mark.parametrize("item", all_effects(), ids=lambda e: e.id)
def test_what_it_says_it_needs_is_what_a_bare_table_lacks(item: Effect) -> None:
    """A text of another column than `missing` asks for, or a need that is not said, would show."""
    table = campaign("", 1.0, 0)
    columns = {name: table.column(name) for name in (*POSE, *WRENCH)}
    weightless = Scene(gravity_m_s2=(0.0, 0.0, 0.0))
    bare = Table(columns, Meta(mechanism={"length_m": L}, scene=weightless), "bare")
    lacking = item.missing(bare)
    if item.id == "debonding":
        assert "other forms need nothing more" in item.needs
        assert lacking is None
    elif lacking is None:
        assert item.needs == ""
    else:
        asked = set(re.findall(r"[A-Za-z0-9_.]{4,}", lacking.record))
        assert asked & set(re.findall(r"[A-Za-z0-9_.]{4,}", item.needs)), lacking.record


@pytest.mark.parametrize("item", all_effects(), ids=lambda e: e.id)
def test_the_jacobian_is_the_derivative_and_zero_is_nothing(item, everything) -> None:  # type: ignore[no-untyped-def]
    rows = rows_for(item.id, everything)
    assert item.missing(rows.table) is None
    for variant in item.variants(rows.table):
        assert type(variant)(**variant.shape).shape == variant.shape
        k = len(variant.parameters)
        scale = np.array([p.scale for p in variant.parameters])
        zero = np.zeros(k)
        assert np.abs(variant.correction(rows, zero)).max() < 1e-8
        at = 0.5 * scale
        jacobian = variant.jacobian(rows, at)
        assert jacobian.shape == (len(rows), 6, k)
        assert np.all(np.isfinite(jacobian))
        if item.kind != "noise":
            assert np.abs(jacobian).max(axis=(0, 1)).min() > 0.0, f"{item.id} does nothing"
        for j in range(k):
            step = np.zeros(k)
            step[j] = 1e-3 * scale[j]
            slope = variant.correction(rows, at + step) - variant.correction(rows, at - step)
            slope /= 2.0 * step[j]
            size = max(np.abs(slope).max(), 1e-300)
            assert np.abs(jacobian[:, :, j] - slope).max() < 1e-3 * size


@pytest.mark.parametrize("item", all_effects(), ids=lambda e: e.id)
def test_variants_and_their_parameters_stand_once(item, everything) -> None:  # type: ignore[no-untyped-def]
    """A report keeps values by name: one that stands twice would be lost."""
    variants = item.variants(rows_for(item.id, everything).table)
    once = [[str(v.shape) for v in variants], *([p.name for p in v.parameters] for v in variants)]
    for names in once:
        assert len(set(names)) == len(names), names


@pytest.mark.parametrize("item", all_effects(), ids=lambda e: e.id)
def test_a_bare_table_is_no_error_but_a_reason(item) -> None:  # type: ignore[no-untyped-def]
    """One displacement and one force: what cannot be tested says why and what to record."""
    table = Table({"x_m": np.arange(5.0), "fx_N": np.arange(5.0)}, Meta(), "bare")
    lacking = item.missing(table)
    if item.id != "outliers":
        assert lacking is not None
        assert lacking.reason
        assert lacking.record


def generalised_skew(item, values: F) -> float:  # type: ignore[no-untyped-def]
    """Skew part of H = d(f, J' tau)/dp of a correction over its size: 0 for a potential."""
    poses = workspace_poses(10, 4)

    def generalised(at: F) -> F:
        columns = {name: at[:, j] for j, name in enumerate(POSE)}
        change = item.correction(Rows(Table(columns, Meta(), "poses"), physics()), values)
        jacobian = _native.left_jacobians(np.ascontiguousarray(at[:, 3:]))
        change[:, 3:] = np.einsum("nji,nj->ni", jacobian, change[:, 3:])
        return change

    hessian = np.empty((len(poses), 6, 6))
    for j, step in enumerate([1e-6] * 3 + [1e-5] * 3):
        d = np.zeros(6)
        d[j] = step
        hessian[:, :, j] = (generalised(poses + d) - generalised(poses - d)) / (2.0 * step)
    return float(np.abs(hessian - np.swapaxes(hessian, 1, 2)).max() / np.abs(hessian).max())


CONSERVATIVE = (
    "strain_stiffening", "compressibility", "pretension", "taper", "length_error",
    "diameter_error", "face_tilt", "pre_curvature", "own_weight", "base_compliance",
)  # fmt: skip


@pytest.mark.parametrize("id", CONSERVATIVE)
def test_conservative_effects_have_a_potential(id: str) -> None:
    item = get_effect(id)
    values = np.array([0.5 * p.scale for p in item.parameters])
    assert generalised_skew(item, values) < 2e-3


@pytest.mark.parametrize("id", ["fts_offset", "fts_gain"])
def test_effects_of_the_sensor_have_none(id: str) -> None:
    item = get_effect(id)
    values = np.array([(-1.0) ** j * 0.5 * p.scale for j, p in enumerate(item.parameters)])
    assert generalised_skew(item, values) > 0.02


def test_offset_and_drift_are_constant_in_body_axes(rows: Rows) -> None:
    offset = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
    body = np.einsum("nji,nj->ni", rows.base_from_top, FtsOffset().correction(rows, offset))
    np.testing.assert_allclose(body, np.tile(offset, (len(rows), 1)), atol=1e-12)
    drift = FtsDrift().correction(rows, offset)
    time = rows.time_s()
    np.testing.assert_allclose(
        drift, time[:, None] * FtsOffset().correction(rows, offset), rtol=1e-12
    )
    settling = FtsDrift(1e9).correction(rows, offset)
    np.testing.assert_allclose(settling, drift, rtol=1e-5)


@pytest.mark.parametrize("more", [{}, {"first_run": 1.0, "since_s": 60.0}])
def test_an_offset_that_acts_before_a_run_says_which_run_and_no_moment(
    more: dict[str, float],
) -> None:
    """It was an offset in all rows, or after the moment, without a word."""
    with pytest.raises(InputError, match="acts 'before' needs first_run, and no since_s"):
        FtsOffset("before", **more)
    assert FtsOffset("before", first_run=1.0).shape["first_run"] == 1.0


def test_payload_weighs_in_base_axes_and_its_torque_turns(rows: Rows) -> None:
    mass, lever = 0.7, np.array([0.02, -0.01, 0.03])
    found = Payload().correction(rows, np.array([mass, *(mass * lever)]))
    gravity = np.array([-9.81, 0.0, 0.0])
    loaded = ~rows.unloaded
    np.testing.assert_allclose(found[loaded, :3], np.tile(-mass * gravity, (loaded.sum(), 1)))
    expected = -cross(rows.rotation @ lever, np.tile(mass * gravity, (len(rows), 1)))
    np.testing.assert_allclose(found[loaded, 3:], expected[loaded], atol=1e-14)
    assert np.all(found[rows.unloaded] == 0.0)


def test_payload_zeroed_with_it_on_reads_nothing_at_the_zeroing_pose() -> None:
    poses = workspace_poses(20, 9)
    poses[0] = [L, 0.0, 0.0, 0.0, 0.0, 0.0]
    columns = {name: poses[:, j] for j, name in enumerate(POSE)}
    meta = Meta(instrument=Instrument(zeroed_with_payload=True))
    rows = Rows(Table(columns, meta, "poses"), physics())
    found = Payload().correction(rows, np.array([0.7, 0.01, 0.002, -0.003]))
    np.testing.assert_allclose(found[0], 0.0, atol=1e-12)
    # (R R_z' - I) m g of force is left elsewhere.
    gravity = np.array([-9.81, 0.0, 0.0])
    expected = 0.7 * (rows.rotation @ gravity - gravity)
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-12)


def test_small_frame_errors_are_the_catalogues_twists(rows: Rows) -> None:
    twist = 1e-4 * np.array([1e-2, -2e-2, 1.5e-2, 1.0, -0.5, 0.7])
    body = np.einsum("nij,j->ni", rows.base_from_top, twist)
    leading = -np.einsum("nij,nj->ni", rows.screw_stiffness, body)
    found = TipFrameMisalignment("base").correction(rows, twist)
    np.testing.assert_allclose(found, leading, atol=2e-3 * np.abs(leading).max())
    turned = np.concatenate(
        [cross(body[:, 3:], rows.wrench[:, :3]), cross(body[:, 3:], rows.wrench[:, 3:])], axis=1
    )
    second = TipFrameMisalignment("measured").correction(rows, twist) - found
    np.testing.assert_allclose(second, turned, atol=2e-3 * np.abs(turned).max())

    d, w = np.tile(twist[:3], (len(rows), 1)), np.tile(twist[3:], (len(rows), 1))
    moved = np.concatenate([d + cross(w, rows.poses[:, :3]), w], axis=1)
    leading = -np.einsum("nij,nj->ni", rows.screw_stiffness, moved)
    found = BaseFrameMisalignment("base").correction(rows, twist)
    np.testing.assert_allclose(found, leading, atol=2e-3 * np.abs(leading).max())


def test_base_compliance_is_the_equilibrium_of_two_springs_in_series(rows: Rows) -> None:
    """The wrench is that of the mechanism at the pose felt on the base plate it loads."""
    values = np.array([3e-3, 4e-6, 2e-6])
    wrench = rows.wrench + BaseCompliance().correction(rows, values)
    force = wrench[:, :3]
    moment = wrench[:, 3:] + cross(rows.poses[:, :3], force)
    turn = moment * np.array([0.0, values[0], values[0]])
    shift = force * np.array([values[2], values[1], values[1]])
    plate = _native.rotation_matrices(np.ascontiguousarray(turn))
    back = np.swapaxes(plate, 1, 2)
    position = np.einsum("nij,nj->ni", back, rows.poses[:, :3] - shift)
    rotation = _native.rotation_vectors(np.ascontiguousarray(back @ rows.rotation))
    felt = rows.predict(np.concatenate([position, rotation], axis=1))
    expected = np.concatenate(
        [np.einsum("nij,nj->ni", plate, felt[:, :3]), np.einsum("nij,nj->ni", plate, felt[:, 3:])],
        axis=1,
    )
    scale = np.abs(wrench).max(axis=0)
    assert np.all(np.abs(wrench - expected).max(axis=0) < 1e-3 * scale)
    # A soft clamp in series is softer: less wrench for the same deflection.
    deflection = rows.poses - rows.rest_pose
    assert np.mean(np.sum((wrench - rows.wrench) * deflection, axis=1)) < 0.0


@pytest.mark.parametrize("form", ["bending", "stretched"])
@pytest.mark.parametrize("values", [[0.05, 0.0], [0.0, 0.05], [0.03, -0.04]])
def test_anisotropy_is_conservative_and_of_order_two(values: list[float], form: str) -> None:
    """H = d(f, J' tau)/dp stays symmetric; a quarter turn of the pose changes the sign."""
    poses, size, effect = workspace_poses(12, 4), np.asarray(values), Anisotropy(form=form)

    def correction(at: F, v: F) -> F:
        columns = {name: at[:, j] for j, name in enumerate(POSE)}
        return effect.correction(Rows(Table(columns, Meta(), "poses"), physics()), v)

    assert generalised_skew(effect, size) < 1e-5

    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turned = np.concatenate([poses[:, :3] @ quarter.T, poses[:, 3:] @ quarter.T], axis=1)
    before = correction(poses, 1e-4 * size)
    after = correction(turned, 1e-4 * size)
    back = np.concatenate([after[:, :3] @ quarter, after[:, 3:] @ quarter], axis=1)
    np.testing.assert_allclose(back, -before, atol=2e-3 * np.abs(before).max())


@pytest.mark.parametrize("form", ["bending", "stretched"])
def test_anisotropy_stiffens_one_plane_and_softens_the_other(form: str) -> None:
    base = physics()
    rest = np.array([[L, 0.0, 0.0, 0.0, 0.0, 0.0]])
    stiffness = base.stiffness(rest)[0]
    bent = np.tile(rest, (2, 1))
    # Pure bending in mid-frame coordinates: r = A (L, 0, 0).
    for row, axis in enumerate((2, 1)):
        bent[row, 3 + axis] = 0.02
        half = _native.rotation_matrices(0.5 * bent[row : row + 1, 3:])[0]
        bent[row, :3] = half @ np.array([L, 0.0, 0.0])
    columns = {name: bent[:, j] for j, name in enumerate(POSE)}
    rows = Rows(Table(columns, Meta(), "poses"), base)
    change = Anisotropy(form=form).correction(rows, np.array([0.01, 0.0]))
    bending = stiffness[5, 5] - stiffness[1, 1] * L**2 / 4.0
    assert change[0, 5] == pytest.approx(0.01 * bending * 0.02, rel=0.02)
    assert change[1, 4] == pytest.approx(-0.01 * bending * 0.02, rel=0.02)


def test_length_error_is_the_first_order_shift_at_rest() -> None:
    base = physics()
    rest = np.array([[L, 0.0, 0.0, 0.0, 0.0, 0.0]])
    columns = {name: rest[:, j] for j, name in enumerate(POSE)}
    rows = Rows(Table(columns, Meta(), "poses"), base)
    change = LengthError().correction(rows, np.array([1e-5]))[0]
    assert change[0] == pytest.approx(-1e-5 * base.stiffness(rest)[0, 0, 0], rel=1e-3)
    assert np.abs(change[1:]).max() < 1e-6


def test_hysteresis_turns_over_with_the_side_of_approach() -> None:
    pose = workspace_poses(2, 11)
    table = Table(
        {
            **{name: np.array([pose[0, j], pose[1, j], pose[0, j]]) for j, name in enumerate(POSE)},
            "pose_id": np.array([0.0, 1.0, 0.0]),
            "approach": np.array(["1", "0", ""], dtype=object),
        },
        Meta(mechanism={"length_m": L}),
        "poses",
    )
    found = Hysteresis("rest").correction(Rows(table, physics()), np.array([1e-4]))
    # The same way to and fro: opposite friction under the stiffness at rest.
    np.testing.assert_allclose(found[0], -found[1], rtol=1e-9, atol=1e-9)
    assert np.abs(found[0]).max() > 0.01
    assert np.all(found[2] == 0.0)


def test_what_is_missing_is_said() -> None:
    table = campaign()
    bare = table.drop("time_s", "dwell_s", "temperature_degC", "approach")
    for id, column in [
        ("fts_drift", "time_s"),
        ("ageing", "time_s"),
        ("stress_relaxation", "dwell_s"),
        ("temperature_modulus", "temperature_degC"),
        ("hysteresis", "approach"),
    ]:
        lacking = get_effect(id).missing(bare)
        assert lacking is not None
        assert column in lacking.record
        assert column in lacking.reason
        assert get_effect(id).missing(table) is None
    one_side = np.where(table.text("kind") == "pose", "initial", "")
    lacking = get_effect("hysteresis").missing(table.with_columns({"approach": one_side}))
    assert lacking is not None
    assert lacking.reason == "one approach direction"
    constant = table.with_columns({"temperature_degC": np.full(len(table), 22.0)})
    lacking = get_effect("temperature_modulus").missing(constant)
    assert lacking is not None
    assert "does not vary" in lacking.reason
    weightless = table.with_meta(
        replace(table.meta, scene=replace(table.meta.scene, gravity_m_s2=(0.0, 0.0, 0.0)))
    )
    lacking = get_effect("payload").missing(weightless)
    assert lacking is not None
    assert "gravity" in lacking.record


def test_an_effect_of_ones_own_in_a_few_lines(rows: Rows) -> None:
    @effect("string", physics="A string pulls down.", parameters={"force": "N"}, scale=0.1)
    def string(rows: Rows) -> F:
        columns = np.zeros((len(rows), 6))
        columns[:, 1] = 1.0
        return columns

    try:
        found = get_effect("string")
        np.testing.assert_allclose(found.correction(rows, np.array([2.0])), 2.0 * string(rows))
        assert found in all_effects()
    finally:
        unregister("string")
    with pytest.raises(InputError, match="did you mean 'fts_drift'"):
        get_effect("fts_drif")
    with pytest.raises(InputError, match="is in the catalogue"):
        register(FtsOffset())


def test_every_effect_says_what_outside_the_catalogue_looks_like_it() -> None:
    for item in (*all_effects(), *effects_for(["theta_z_rad", "tau_z_Nm"])):
        assert item.outside.what.startswith("any"), item.id
        assert item.outside.apart, item.id
    assert not EffectBase().outside


def test_nothing_weighs_less_than_nothing() -> None:
    mass = get_effect("own_weight").parameters[0]
    assert mass.allows(0.05)
    assert not mass.allows(-0.05)
