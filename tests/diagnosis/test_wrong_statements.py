"""What the user states wrongly is found by the tool and named as what it is."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import Diagnosis, diagnose
from ecm.diagnosis.procedure import find_missing
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.conventions import wrong_convention
from ecm.io.description import Meta
from ecm.io.table import Table, as_table, read_table
from ecm.models import fit_model
from ecm.models.check import check
from support.campaigns import INSTRUMENT, META, NOISE, campaign, model, workspace_poses
from support.neck import ROOT, columns_of
from support.stand_in import L, wrench


def turned(axis: str, degrees: float) -> F:
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


def in_axes(h: F, turn: F) -> F:
    """The wrench as it is written down in turned axes."""
    return np.hstack([h[:, :3] @ turn.T, h[:, 3:] @ turn.T])


def table_of(poses: F, h: F) -> Table:
    columns = columns_of(poses, h)
    return as_table(columns | {"time_s": 9.0 * np.arange(len(poses))}, meta=META)


def stated(change: Callable[[F, F], tuple[F, F]]) -> Diagnosis:
    """The verdict on rows that were written down wrongly."""
    poses, random = workspace_poses(120, 7), np.random.default_rng(8)
    h = wrench(poses) + random.standard_normal((120, 6)) * NOISE
    table = table_of(*change(poses, h))
    return diagnose(
        fit_model(table, "linear", force=True),
        table,
        effects=["anisotropy", "payload", "fts_frame"],
    )


def euler(poses: F) -> F:
    angles = Rotation.from_rotvec(poses[:, 3:]).as_euler("XYZ")
    return np.hstack([poses[:, :3], angles])


def inverse(poses: F) -> F:
    turns = Rotation.from_rotvec(poses[:, 3:]).inv()
    return np.hstack([-turns.apply(poses[:, :3]), turns.as_rotvec()])


def quaternion_read(poses: F, written: str) -> F:
    """Four numbers with the scalar last that are read with the scalar first, or the reverse."""
    four = Rotation.from_rotvec(poses[:, 3:]).as_quat(scalar_first=written == "wxyz")
    return np.hstack(
        [poses[:, :3], Rotation.from_quat(four, scalar_first=written != "wxyz").as_rotvec()]
    )


def about_the_base(p: F, h: F) -> F:
    return np.hstack([h[:, :3], h[:, 3:] + np.cross(p[:, :3], h[:, :3])])


READINGS = [
    (lambda p, h: (p, in_axes(h, turned("x", 90))), "axes look turned by 90 degrees about x"),
    (lambda p, h: (p, h * [1, -1, 1, -1, 1, -1]), "the y axis of the wrench looks reversed"),
    (lambda p, h: (p, about_the_base(p, h)), "about the base's origin"),
    (lambda p, h: (inverse(p), h), "the pose looks inverted"),
    (lambda p, h: (p * [1, 1, 1, -1, -1, -1], h), "the rotation looks transposed"),
    (lambda p, h: (euler(p), h), "Euler angles in the order xyz"),
    (lambda p, h: (quaternion_read(p, "xyzw"), h), "a quaternion as wxyz, which is xyzw"),
]
"""They are told with a length and without."""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, h: (p, in_axes(h, turned("z", 90))), "axes look turned by 90 degrees about z"),
        (lambda p, h: (p, in_axes(h, turned("y", -90))), "axes look turned by -90 degrees about y"),
        (lambda p, h: (p, h * [1, 1, 1, -1, -1, -1]), "the torque's sign looks reversed"),
        (lambda p, h: (p, h * [1, 1, 1, 1e3, 1e3, 1e3]), "the torque looks stated in N mm"),
        (lambda p, h: (p, h[:, [0, 2, 1, 3, 5, 4]]), "columns y and z of the wrench look"),
        *READINGS,
        (lambda p, h: (quaternion_read(p, "wxyz"), h), "a quaternion as xyzw, which is wxyz"),
        (lambda p, h: (p * [1, 1, 1, *[np.pi / 180] * 3], h), "57.3 once too often"),
    ],
)  # fmt: skip
def test_it_is_named_as_what_it_is(change: Callable[[F, F], tuple[F, F]], words: str) -> None:
    found = stated(change)
    assert found.verdict == "unknown"
    assert found.answer == ()
    assert words in found.sentence()
    assert found.unknown is not None
    statement = found.unknown.statement
    assert statement is not None
    assert statement.error_after < 1.3
    assert statement.error_before > 6.0
    assert found.to_dict()["unknown"]["statement"]["what"] == statement.what


TOOL = np.array([0.012, 0.009, -0.004])


@pytest.mark.parametrize(
    ("change", "entry", "sign"),
    [
        (lambda p: Rotation.from_rotvec(p[:, 3:]).apply(TOOL), "top_from_tool", 1.0),
        (lambda p: np.broadcast_to(TOOL, (len(p), 3)), "base_from_robot", -1.0),
    ],
)
def test_the_point_that_is_said_goes_into_the_frames(
    change: Callable[[F], F], entry: str, sign: float, tmp_path: Path
) -> None:
    """As the sentence says, with these numbers, and the poses are those of the top again."""
    found = stated(lambda p, h: (np.hstack([p[:, :3] + change(p), p[:, 3:]]), h))
    said = re.search(r"\(([-\d., ]+)\) mm away \((add it to|take it from) (\w+)", found.sentence())
    assert said is not None
    assert said.group(2, 3) == ("add it to" if sign > 0.0 else "take it from", entry)
    at = 1e-3 * sign * np.array([float(number) for number in said.group(1).split(",")])
    poses = workspace_poses(120, 7)
    logged = np.hstack([poses[:, :3] + change(poses), poses[:, 3:]])
    table_of(logged, wrench(poses)).write(tmp_path / "log.csv")
    with open(tmp_path / "log.toml", "a") as file:
        file.write(f"\n[frames]\n{entry} = {[*at.tolist(), 1.0, 0.0, 0.0, 0.0]}\n")
    assert np.abs(read_table(tmp_path / "log.csv").poses - poses).max() < 3e-4


@pytest.mark.parametrize("mounted", ["fixed", "on the platform", "not read as of a sensor"])
def test_a_sensor_that_is_mounted_at_an_angle(mounted: str) -> None:
    """Axes that are turned by less than a quarter ended as time, cross-talk, or too few terms."""
    sensor = Rotation.from_rotvec(np.radians([25.0, -4.0, 3.0]))

    def change(poses: F, h: F) -> tuple[F, F]:
        top = Rotation.from_rotvec(poses[:, 3:])
        axes = sensor if mounted == "fixed" else top * sensor
        read = np.hstack([axes.inv().apply(part) for part in np.hsplit(h, 2)])
        if mounted == "on the platform":  # turned to the base as if its axes were those of the top
            read = np.hstack([top.apply(part) for part in np.hsplit(read, 2)])
        return poses, read

    said = stated(change).sentence()
    against = "base" if mounted == "fixed" else "top"
    assert ("a force sensor that moves" in said) == (mounted == "not read as of a sensor")
    found = re.search(rf"turned by \((.*)\) deg, .* those of the {against} \(state \w+", said)
    assert found is not None, said
    assert [float(angle) for angle in found[1].split(",")] == pytest.approx([25, -4, 3], abs=0.5)


def test_a_turned_wrench_beside_a_body() -> None:
    """The physics base, with all effects of the catalogue to imitate it."""
    table = campaign("", 1.0, 4)
    h = in_axes(table.wrenches, turned("x", 90))
    wrong = table.with_columns(dict(zip(WRENCH, h.T, strict=True)))
    found = diagnose(model(), wrong)
    assert "The table looks misread: the wrench's axes look turned by 90 degrees about x" in (
        found.sentence()
    )


def test_a_reversed_wrench_is_said_without_a_body_and_without_a_length() -> None:
    poses, random = workspace_poses(120, 7), np.random.default_rng(8)
    h = wrench(poses) + random.standard_normal((120, 6)) * NOISE
    wrong = table_of(poses, -h).with_meta(Meta(instrument=META.instrument))
    found = diagnose(fit_model(wrong, "cubic", force=True), wrong)
    assert found.verdict == "unknown"
    assert "the wrench's sign looks reversed" in found.sentence()
    assert any("sign looks reversed" in words for words in check(wrong).warnings)
    right = table_of(poses, h).with_meta(Meta(instrument=META.instrument))
    assert not any("sign looks reversed" in words for words in check(right).warnings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, h: (p, h * [1, 1, 1, -1, -1, -1]), "misread: the torque's sign looks reversed:"),
        *READINGS,
        (lambda p, h: (p, h), ""),
        (lambda p, h: (in_axes(p, turned("y", 90)), in_axes(h, turned("y", 90))), ""),
    ],
)  # fmt: skip
def test_without_a_length_the_wrench_must_have_an_energy(
    change: Callable[[F, F], tuple[F, F]], words: str
) -> None:
    """A polynomial takes in every one of these readings; the axes of both are free to choose."""
    poses, random = workspace_poses(70, 7), np.random.default_rng(8)
    h = wrench(poses) + random.standard_normal((70, 6)) * NOISE
    table = table_of(*change(poses, h)).with_meta(Meta(instrument=META.instrument))
    found = find_missing(fit_model(table, "quadratic", force=True), table, effects=["payload"])
    said = f"misread: {found.unknown.words}" if found.misread and found.unknown else ""
    assert words in said if words else said == ""


def test_a_spring_that_is_plain_in_the_rotation_vector_is_not_in_degrees() -> None:
    """Between small angles its law has an energy, whatever the unit is."""
    random = np.random.default_rng(2)
    poses = random.uniform(-1.0, 1.0, (80, 6)) * np.repeat([0.004, 0.3], 3) + [0.05, 0, 0, 0, 0, 0]
    noise = random.standard_normal((80, 6)) * np.repeat([0.02, 2e-4], 3)
    h = (poses - [0.05, 0, 0, 0, 0, 0]) * [3000.0, 300.0, 300.0, 0.3, 0.5, 0.5] + noise
    own = replace(META.instrument, force_sd_N=0.02, torque_sd_Nm=2e-4)
    table = table_of(poses, h).with_meta(Meta(instrument=own))
    found = find_missing(fit_model(table, "linear", force=True), table, effects=["payload"])
    assert found.verdict == "none"


def test_a_polynomial_that_leaves_much_follows_no_period_in_time() -> None:
    """Rows under large loads err most where a base is too plain: they are no rhythm."""
    poses, random = workspace_poses(120, 7), np.random.default_rng(8)
    h = wrench(poses) + random.standard_normal((120, 6)) * NOISE
    table = table_of(poses, h).with_meta(Meta(instrument=META.instrument))
    found = find_missing(fit_model(table, "cubic", force=True), table, effects=["payload"])
    assert found.verdict == "none"


def test_a_turned_wrench_on_a_body_whose_ends_differ() -> None:
    """The energy that takes both ends as alike leaves too much of any reading."""
    poses, random = workspace_poses(120, 7), np.random.default_rng(8)
    thick = wrench(poses)
    # A spring beside the axis of the top alone: one end gets stiffer.
    thick[:, 3:] += 20.0 * poses[:, 3:]
    h = thick + random.standard_normal((120, 6)) * NOISE
    table = table_of(poses, in_axes(h, turned("x", 90)))
    found = find_missing(fit_model(table, "linear", force=True), table, effects=["payload"])
    assert found.unknown is not None
    assert "turned by 90 degrees about x" in found.unknown.words


@pytest.mark.parametrize(
    ("names", "words"),
    [(("fx_N",), "the sign of fx looks reversed"), (WRENCH, "the wrench's sign looks reversed")],
)
@pytest.mark.parametrize("name", ["energy4", "quadratic"])
def test_a_reversed_sign_is_no_effect(name: str, names: tuple[str, ...], words: str) -> None:
    """An energy of the other sign fits as well, and temperature_modulus was named for the rest."""
    table = read_table(ROOT / "examples" / "neck_measured.csv")
    table = table.with_meta(replace(table.meta, mechanism={"length_m": L}))
    wrong = table.with_columns({one: -table.column(one) for one in names})
    few = ["temperature_modulus", "payload", "fts_gain"]
    found = diagnose(fit_model(wrong, name, force=True), wrong, effects=few)
    assert found.verdict == "unknown"
    assert found.answer == ()
    assert words in found.sentence()
    said = wrong_convention(wrong)
    assert said is not None
    assert said.sentence() in found.warnings


@pytest.mark.parametrize(
    ("scale", "begin", "words"),
    [
        (1.0 / 60.0, 0.0, "time_s looks stated in minutes"),
        (1e3, 0.0, "time_s looks stated in milliseconds"),
        (1.0, 1e7, "time_s begins only at 1e+07 s"),
    ],
)
def test_another_unit_or_start_of_time(scale: float, begin: float, words: str) -> None:
    table = campaign("", 1.0, 4)
    assert not any("time_s" in said for said in check(table).warnings)
    wrong = table.with_columns({"time_s": begin + scale * table.column("time_s")})
    assert any(words in said for said in check(wrong).warnings)


def test_a_right_table_with_a_strong_effect_is_not_called_misread() -> None:
    for effect in ("base_compliance", "tip_frame_misalignment"):
        found = find_missing(model(), campaign(effect, 6.0, 4))
        assert found.unknown is None or found.unknown.statement is None


def test_a_reading_whose_stiffness_only_makes_the_noise_large_is_no_better_one() -> None:
    """No energy has this wrench: at negated poses one is so stiff that the poses' noise is all."""
    random, count = np.random.default_rng(11), 120
    shift = random.uniform(-1.0, 1.0, (count, 6)) * [1.5e-3, 8e-3, 8e-3, 0.25, 0.4, 0.4]
    shift[:, 1:3] += 0.05 * shift[:, [5, 4]] * [1.0, -1.0]
    h = shift * [9e3, 2.6e3, 2.6e3, 3.2, 9.5, 9.5]
    h[:, 1:3] += 2e7 * shift[:, 1:3] ** 3
    h += random.standard_normal((count, 6)) * NOISE
    instrument = replace(INSTRUMENT, pose_position_sd_m=1e-5, pose_rotation_sd_rad=1.5e-4)
    table = table_of(shift + np.r_[L, np.zeros(5)], h)
    table = replace(table, meta=replace(META, instrument=instrument))
    found = find_missing(fit_model(table, "cubic"), table, effects=["payload"])
    assert found.unknown is None or found.unknown.statement is None
