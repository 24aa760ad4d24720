"""Diagnosis of a real joint whose data hold more than the model uses (../shared/data)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecm.comparison.residuals import confounded_with_order
from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.table import Table, read_table
from ecm.models import fit_model
from ecm.regression.rows import derived_columns
from support.neck import ROOT

META = ROOT / "examples" / "finger_joint.toml"
FORCE = "column_6"
"""The weight, of which the model knows nothing: it has rotations in and torques out."""
POSES = ("theta_x_rad", "theta_y_rad", "theta_z_rad")
TORQUES = ("tau_x_Nm", "tau_y_Nm", "tau_z_Nm")


@pytest.fixture(scope="module")
def joint(shared_data: Path) -> Table:
    path = shared_data / "finger_joint" / "03April2018_full_calculated_data.csv"
    return read_table(path, meta=META)


@pytest.fixture(scope="module")
def found(joint: Table) -> Diagnosis:
    return diagnose(fit_model(joint, "cubic"), joint)


def test_an_unused_input_explains_part_of_the_residual(found: Diagnosis, joint: Table) -> None:
    assert found.verdict == "family"
    assert found.family is not None
    assert found.family.driver == FORCE
    assert found.unknown is not None
    assert FORCE in found.unknown.variables
    force = joint.column(FORCE)
    shuffled = np.random.default_rng(0).permutation(force)
    without = diagnose(fit_model(joint, "cubic"), joint.with_columns({FORCE: shuffled}))
    assert without.unknown is not None
    assert FORCE not in without.unknown.variables


def test_load_and_time_cannot_be_separated(found: Diagnosis, joint: Table) -> None:
    """Weights ascend at each position; with their rows shuffled within it they do not."""
    assert {FORCE, "load"} <= set(confounded_with_order(joint, POSES, TORQUES))
    assert any("load and time cannot be separated" in text for text in found.warnings)
    order = np.random.default_rng(1).permutation(len(joint))
    assert confounded_with_order(joint.select(order), POSES, TORQUES) == ()


def test_what_was_computed_from_the_torque_is_no_cause(found: Diagnosis, joint: Table) -> None:
    """Columns 13 and 14 are the author's linear estimate, 16 and 17 what it leaves."""
    out = derived_columns(joint, POSES, TORQUES)
    assert set(out) == {"column_13", "column_14", "column_16", "column_17"}
    assert found.unknown is not None
    assert not set(out) & set(found.unknown.variables)


def test_z_was_never_excited(found: Diagnosis) -> None:
    assert any("never excited: tau_z_Nm" in text for text in found.warnings)
