"""`ecm compare`: noise floor, excess error, and where."""

from __future__ import annotations

from collections.abc import Sequence

from ecm.cli.models import open_model
from ecm.cli.options.compare import Options
from ecm.cli.session import Session
from ecm.cli.text import columns
from ecm.comparison import Comparison
from ecm.comparison import compare as compare_model
from ecm.comparison.page import write_comparison
from ecm.comparison.reference_models import FEM_NEEDED
from ecm.diagnosis.check import excitation_sentences, never_excited
from ecm.effects import load_installed
from ecm.errors import Remedy
from ecm.io.columns import unit_of

_WORST_POSES = 3


def compare(options: Options, session: Session) -> None:
    """Run `ecm compare`."""
    load_installed()
    table = session.read(options.data, need="fit")
    model = open_model(options.model, session, table)
    with session.working(f"comparing with {len(table)} rows") as tell:
        result = compare_model(model, table, seed=session.seed, progress=tell)
        result.complete(tell)
        document = result.to_dict()
    warnings = [*result.warnings, *table.warnings]
    constant = never_excited(table)
    session.write_json({**document, "never_excited": list(constant), "warnings": warnings})
    if session.report is not None:
        with session.working("writing the report"):
            write_comparison(session.report, result, warnings)
    session.print(_errors(result, constant) + "\n")
    if result.lack_of_fit is not None:
        session.print(_lack_of_fit(result, constant) + "\n")
    session.print(result.sentence())
    session.print(result.pose_error.sentence())
    if result.pose_error.row.size:
        session.print(_worst_poses(result))
    if result.references is not None:
        assumed = result.noise.is_assumed
        levels = result.references.levels_in_words(noise_is_assumed=assumed)
        session.print(levels if assumed else f"{levels} {result.references.sentence()}")
        if result.references.fem_needed:
            shown = Remedy(FEM_NEEDED, "ecm fit DATA --model physics --out physics.json && AGAIN")
            session.print(str(shown.filled(session.files_of(options))))
    if result.rows_used is not None:
        session.print(result.rows_used.sentence())
    for warning in result.warnings:
        session.warn(warning)
    for sentence in excitation_sentences(constant):
        session.print(sentence)


def _errors(result: Comparison, constant: Sequence[str]) -> str:
    """Error, noise floor and excess error of each component that was excited."""
    rows = [("component", "rmse", "bias", "noise floor", "excess", "90 % interval", "unit")]
    for item in result.components:
        if item.name not in constant:
            error = (item.name, f"{item.rmse:.3g}", f"{item.bias:.3g}")
            noise = (f"{item.floor:.3g}", f"{item.excess:.3g}")
            interval = f"{item.excess_low:.3g} .. {item.excess_high:.3g}"
            # Noise that nobody measured or declared is no floor.
            known = ("-",) * 3 if result.noise.is_assumed else (*noise, interval)
            rows.append((*error, *known, unit_of(item.name)))
    return columns(rows)


def _worst_poses(result: Comparison) -> str:
    """The rows with the largest pose error."""
    units = {"position_mm": " mm", "rotation_deg": "°"}
    listed = [
        f"row {item.pop('row')} ({', '.join(f'{v:.2g}{units[name]}' for name, v in item.items())})"
        for item in result.pose_error.worst(_WORST_POSES)
    ]
    return f"Worst rows by pose error: {', '.join(listed)}."


def _lack_of_fit(result: Comparison, constant: Sequence[str]) -> str:
    """F of the model's error between repeated poses over the scatter of the repeats."""
    tests = {"all": result.lack_of_fit} | {c.name: c.lack_of_fit for c in result.components}
    rows = [("lack of fit", "F", "dof", "of error", "p")]
    for name, test in tests.items():
        if test is not None and name not in constant:
            dof = f"{test.dof:.4g}", f"{test.dof_error:.4g}"
            rows.append((name, f"{test.F:.6g}", *dof, f"{test.p:.2g}"))
    return columns(rows)
