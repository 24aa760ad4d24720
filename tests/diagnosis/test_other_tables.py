"""Diagnosis of tables unlike the rig's: few rows, some of the columns, columns that never vary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecm.comparison import compare
from ecm.comparison.residuals import confounded_with_order
from ecm.diagnosis import DiagnosisSettings, diagnose
from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.procedure import STAGES, begin, go_on
from ecm.diagnosis.statements import _residual
from ecm.effects import Rows
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta, read_meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.fit import polynomial
from support.campaigns import INSTRUMENT
from support.meshes import block_mesh
from support.neck import LENGTH_M, neck_columns

ALL = (*POSE, *WRENCH)
BODY = {"length_m": LENGTH_M}


def neck(rows: int, columns: tuple[str, ...] = ALL, length: bool = False) -> Table:
    """Rows of a neck; with its length the base is an energy, without it a polynomial."""
    own = neck_columns(rows)
    meta = Meta(mechanism=BODY if length else {}, instrument=INSTRUMENT)
    return as_table({name: own[name] for name in columns}, meta=meta)


# --- few rows -------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("rows", "columns", "length"),
    [
        (8, ALL, True),
        (8, ALL, False),
        (60, ALL, False),
        (8, (*POSE[:3], *WRENCH[:3]), False),
        (8, (*POSE, *WRENCH[:3]), False),
    ],
)
def test_a_degree_that_the_rows_cannot_carry_is_passed_over(
    rows: int, columns: tuple[str, ...], length: bool
) -> None:
    """Each asks of some trial degree more coefficients than there are equations."""
    table = neck(rows, columns, length)
    found = diagnose(fit_model(table, "linear", force=True), table)
    assert found.base.kind == ("energy" if length else "polynomial")


def test_a_comparison_stands_where_no_energy_can_be_fitted() -> None:
    """Three rows are too few for any degree of the energy; the model is compared all the same."""
    many = neck(60, length=True)
    assert compare(fit_model(many, "linear"), many.select(np.arange(3))).references is None
    eight = compare(fit_model(many, "linear"), many.select(np.arange(8))).references
    assert eight is not None
    assert eight.energy is not None


@pytest.mark.parametrize(("rows", "columns"), [(12, (*POSE[:3], *WRENCH[:3])), (20, ALL)])
def test_a_small_f_is_no_proof_that_little_is_missing(rows: int, columns: tuple[str, ...]) -> None:
    """By chance, or because a base of many coefficients has taken noise as well."""
    table = neck(rows, columns)
    found = diagnose(fit_model(table, "linear", force=True), table)
    assert found.gate.F < 0.8
    assert found.upper_bound > 0.3


def test_where_no_row_is_left_to_judge_by_there_is_no_bound() -> None:
    table = neck(8)
    found = diagnose(fit_model(table, "linear"), table)
    assert found.upper_bound == np.inf
    assert "too few rows to bound s" in found.sentence()


# --- columns that never vary ----------------------------------------------------------------------
@pytest.mark.parametrize("constant", [0.123, 7.77])
def test_a_force_that_never_varies_does_not_choose_the_degree(constant: float) -> None:
    """Its spread is a rounding error; divided by that, rounding decides the degree."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1e-3, 1e-3, 100)
    force = 1e4 * x + 3e9 * x**3 + 0.02 * rng.standard_normal(100)
    table = as_table({"x_m": x, "fx_N": force, "fz_N": np.full(100, constant)})
    base = polynomial(table)
    assert base.name == "poly:3"
    left = force - base.predict(x[:, None])[:, 0]
    assert left.std() == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize("constant", [0.5, 0.123])
def test_a_force_that_never_varies_does_not_hide_the_order_of_the_load(constant: float) -> None:
    """Over a spread of nothing it would be all of the load, or more than a double holds."""
    x = np.linspace(0.0, 1e-3, 40)
    table = as_table({"x_m": x, "fx_N": 1e4 * x, "fz_N": np.full(40, constant)})
    assert confounded_with_order(table, ("x_m",), ("fx_N", "fz_N")) == ("load",)


# --- bases of many columns ------------------------------------------------------------------------
def test_a_base_too_large_for_the_design_is_tested_as_if_it_were_there() -> None:
    """What the base explains is no degree of freedom of a test, and takes those of the noise."""
    table = neck(90)
    model = fit_model(table, "poly:1")
    limits = [DiagnosisSettings(most_base_columns=most) for most in (1000, 0)]
    prepared = prepare(model, table)
    begun = [begin(model.base, prepared, None, own, STAGES) for own in limits]
    found = [go_on(own, 0, STAGES) for own in begun]
    carried, apart = found
    assert carried.problem.n_base == 42
    assert apart.problem.n_base == 0
    assert apart.problem.ids == carried.problem.ids
    assert apart.problem.untestable == carried.problem.untestable
    assert apart.problem.scale == pytest.approx(carried.problem.scale, rel=1e-6)
    assert apart.gate.smooth.dof == carried.gate.smooth.dof
    assert apart.gate.smooth.dof_error == carried.gate.smooth.dof_error
    assert pytest.approx(carried.gate.F, rel=1e-6) == apart.gate.F
    assert apart.gate.p == pytest.approx(carried.gate.p, rel=1e-6)
    assert apart.left.p == pytest.approx(carried.left.p, rel=1e-4)
    rests = [_residual(one.problem, one.problem.scored) for one in found]
    free = [float(np.einsum("nii->", kept)) for _, kept in rests]
    assert free[1] == pytest.approx(free[0], rel=1e-9)
    assert (rests[1][0] ** 2).sum() == pytest.approx((rests[0][0] ** 2).sum(), rel=1e-9)


def test_a_large_base_hides_no_structure_from_the_gate() -> None:
    """Two thirds of the noise in one component, beside 504 coefficients on 300 rows."""
    own = neck_columns(300, seed=2)
    spread = {name: (own[name] - own[name].mean()) / own[name].std() for name in POSE}
    for name, other in zip(WRENCH, (*POSE[3:], *POSE[:3]), strict=True):
        own[name] = own[name] + 0.5 * own[name].std() * spread[other] ** 3
    humidity = np.random.default_rng(0).standard_normal(300)
    found = []
    for size in (0.0, 0.2):
        columns = own | {"fx_N": own["fx_N"] + size * humidity, "humidity": humidity}
        table = as_table(columns, meta=Meta(instrument=INSTRUMENT))
        assert polynomial(table).name == "poly:3"
        found.append(diagnose(fit_model(table, "linear"), table))
    nothing, missing = found
    assert nothing.verdict == "none"
    assert 0.7 < nothing.gate.F < 1.4
    assert missing.verdict == "named"
    assert missing.answer == (("unused_column:humidity",),)


# --- noise of some of the columns -----------------------------------------------------------------
def spring(instrument: Instrument, rows: int = 200) -> Table:
    """One displacement and one force of a spring that hardens; 0.3 N of noise."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1e-3, 1e-3, rows)
    force = 1e4 * x + 3e9 * x**3 + 0.3 * rng.standard_normal(rows)
    return as_table({"x_m": x, "fx_N": force}, meta=Meta(instrument=instrument))


@pytest.mark.parametrize(
    "told",
    [
        Instrument(pose_position_sd_m=1e-6, force_sd_N=0.1),
        Instrument(1e-6, 1e-9, 0.1, 1e-9),
    ],
)
def test_declared_noise_counts_for_a_displacement_and_a_force(told: Instrument) -> None:
    """Figures of columns that are not there are not asked for."""
    table = spring(told)
    compared = compare(fit_model(table, "cubic"), table)
    assert compared.noise.source == "declared"
    assert compared.noise.force_sd_N == 0.1
    assert compared.whitened_rms == pytest.approx(3.0, rel=0.1)
    found = diagnose(fit_model(table, "cubic"), table)
    assert found.noise.source == "declared"
    assert found.rmse.floor["fx_N"] == pytest.approx(0.1, rel=0.02)
    assert [text for text in found.warnings if "times as large as declared" in text]
    assert not [text for text in found.warnings if "noise is assumed" in text]


def test_some_of_the_figures_that_are_needed_are_not_enough() -> None:
    table = spring(Instrument(force_sd_N=0.1, torque_sd_Nm=0.01))
    assert compare(fit_model(table, "cubic"), table).noise.source == "assumed"
    exact = spring(Instrument(pose_position_sd_m=0.0, force_sd_N=0.0))
    assert compare(fit_model(exact, "cubic"), exact).noise.source == "assumed"


@pytest.mark.parametrize("columns", [ALL, (POSE[0], WRENCH[0], WRENCH[5])])
def test_a_figure_of_nothing_is_refused_with_what_to_give(columns: tuple[str, ...]) -> None:
    """Rows cannot be weighed by a torque without noise; it was a matrix that is not positive."""
    own = neck_columns(60)
    told = Meta(instrument=Instrument(0.0, 0.0, 0.3, 0.0))
    table = as_table({name: own[name] for name in columns}, meta=told)
    model = fit_model(as_table({name: own[name] for name in columns}), "linear")
    with pytest.raises(InputError, match="torque_sd_Nm above 0"):
        compare(model, table)


@pytest.mark.parametrize("name", ["gp", "mlp"])
def test_a_learned_model_of_two_columns_is_not_measured_by_a_rig_of_twelve(name: str) -> None:
    """40 um through the stiffness of a spring are more than it errs: any would look good."""
    pytest.importorskip("sklearn")
    table = spring(Instrument())
    model = fit_model(table, name)
    left = table.column("fx_N") - model.predict(table)[:, 0]
    assert model.noise.components == pytest.approx((float(np.sqrt((left**2).mean())),))
    lacking = "pose_position_sd_m, force_sd_N nothing says how much of it is noise"
    assert lacking in compare(model, table).sentence()


# --- a body that is told by a mesh ----------------------------------------------------------------
MESH_TOML = '[mechanism]\nmesh = "body.msh"\n'


def test_the_length_of_a_mesh_is_that_of_the_mechanism(tmp_path: Path) -> None:
    """[mechanism] mesh without length_m: the energy model needs nothing more."""
    (tmp_path / "body.msh").write_text(block_mesh(), encoding="utf-8")
    told = tmp_path / "neck.toml"
    told.write_text(MESH_TOML, encoding="utf-8")
    columns = neck_columns(60)
    columns["x_m"] = columns["x_m"] - LENGTH_M + 0.1
    table = as_table(columns, meta=read_meta(told))
    assert table.meta.length_m == pytest.approx(0.1)
    model = fit_model(table, "energy4")
    assert model.length_m == pytest.approx(0.1)
    assert Rows(table, fit_model(table, "linear").base).rest_pose[0] == pytest.approx(0.1)
    references = compare(fit_model(table, "linear"), table).references
    assert references is not None
    assert references.energy is not None


def test_a_table_stands_without_the_file_of_its_mesh(tmp_path: Path) -> None:
    """Who does not ask for the body need not have it."""
    told = tmp_path / "neck.toml"
    told.write_text(MESH_TOML, encoding="utf-8")
    table = as_table(neck_columns(60), meta=read_meta(told))
    assert table.meta.length_m is None
    assert compare(fit_model(table, "linear"), table).whitened_rms < 2.0
