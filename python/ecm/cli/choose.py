"""`ecm fit --model choose` and `--curve`: which model, and how many poses are enough."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH

if TYPE_CHECKING:
    from ecm.cli.console import Console
    from ecm.io.table import Table
    from ecm.models import ModelSpecification

_SIZES = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 700, 1000, 1500)


def chosen_model(
    table: Table, pcr: str | None, seed: int, console: Console
) -> tuple[str, ModelSpecification, dict[str, Any]]:
    """Name and specification of the best model, and the errors of all candidates (for --json)."""
    from ecm.models import choose_model, parse_model

    if pcr is not None:
        raise InputError("--model choose tries PCR thresholds itself; leave out --pcr")
    candidates: list[tuple[str, str | None]]
    candidates = [("linear", None), ("quadratic", None), ("cubic", None)]
    candidates += [("cubic", "press"), ("cubic", "0.01/sqrtN")]
    if table.pose_columns == POSE and table.wrench_columns == WRENCH:
        if table.meta.length_m is not None:
            candidates += [(f"energy{degree}", None) for degree in (4, 5, 6)]
        else:
            console.say("energies are left out: no [mechanism] length_m in the data's TOML")
    else:
        raise InputError(
            "--model choose needs all six pose and wrench columns: its errors are over the noise "
            "of a row; name a model instead"
        )
    models = [parse_model(name, pcr=threshold) for name, threshold in candidates]
    found = choose_model(table, models, seed=seed)
    listed = []
    for i, (model, threshold) in enumerate(candidates):
        name = model + ("" if threshold is None else f" --pcr {threshold}")
        error = float(found.error[i])
        if np.isfinite(error):
            console.say(
                f"{name}: {found.coefficients[i]} coefficients, held-out error "
                f"{error:.3g} +- {found.standard_error[i]:.2g} of the noise"
            )
        listed.append(
            {
                "model": model,
                "pcr": threshold,
                "coefficients": found.coefficients[i],
                "error": error if np.isfinite(error) else None,
                "chosen": i == found.chosen,
            }
        )
    console.say("chosen: the fewest coefficients within one standard error of the smallest error")
    return candidates[found.chosen][0], found.best, {"candidates": listed}


def how_many_poses(table: Table, name: str, seed: int, console: Console) -> dict[str, Any]:
    """The learning curve of the model, said and for --json."""
    from ecm.models import learning_curve

    curve = learning_curve(table, name, _SIZES, seed=seed)
    for n, error in zip(curve.sizes, curve.error, strict=True):
        if np.isfinite(error):
            console.say(f"{name} from {n} poses: held-out error {error:.3g} of the noise")
    if curve.enough is None:
        console.say("not enough: the curve still falls at the last of these; measure more poses")
    else:
        console.say(
            f"enough: {curve.enough} poses are within 5 %, {curve.one_standard_error} within one "
            "standard error of the best"
        )
    return {
        "sizes": list(curve.sizes),
        "error": [float(e) if np.isfinite(e) else None for e in curve.error],
        "enough": curve.enough,
        "one_standard_error": curve.one_standard_error,
    }
