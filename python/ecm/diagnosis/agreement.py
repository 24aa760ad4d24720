"""When a name is believed while rows are still measured: diagnoses of more and more rows agree.

The rows are those of a plan in its own order, which is random, so that dwell and side of approach
do not grow with time. An order by what each row tells about the suspected effects, per minute,
was tried and named them no earlier (docs/measure.md).
"""

from __future__ import annotations

from collections.abc import Sequence

from ecm.designs.next_pose import NextPose
from ecm.diagnosis.procedure import find_missing
from ecm.errors import EcmError
from ecm.io.table import Table
from ecm.models import Model

_FEWEST = 12
"""Rows before the first diagnosis."""
_GROWTH = 1.15
"""Growth of the rows between two diagnoses."""
AGREE = 3
"""Diagnoses in a row that must give the same name: with few rows a rival fits as well for a while.
"""


def agreed(names: Sequence[tuple[str, ...]]) -> bool:
    """Whether the last diagnoses named the same.

    Examples
    --------
    >>> agreed([("payload",)] * 3), agreed([(), (), ()]), agreed([("payload",)] * 2)
    (True, False, False)
    """
    last = list(names)[-AGREE:]
    return len(last) == AGREE and bool(last[0]) and len(set(last)) == 1


def is_due(rows: int) -> bool:
    """Whether the rows are diagnosed at this number.

    Examples
    --------
    >>> [n for n in range(40) if is_due(n)]
    [12, 15, 19, 23, 28, 34]
    """
    due = _FEWEST
    while due < rows:
        due = int(_GROWTH * due) + 2
    return due == rows


def names_of(rows: Table, model: Model | None = None, seed: int = 0) -> tuple[str, ...]:
    """Return what a diagnosis of the rows names alone; empty where it names nothing.

    Parameters
    ----------
    rows
        Measured rows.
    model
        The model that lacks something; None: the energy of the least AIC of the rows.
    seed
        Seed of the diagnosis.

    Examples
    --------
    >>> import ecm
    >>> names_of(ecm.as_table({"x_m": [0.1, 0.101], "fx_N": [0.0, 1.0]}))
    ()
    """
    try:
        if model is None:
            poses = rows.measured()
            energies = NextPose(poses, "N")
            energies.learn(poses)
            model = energies.model
        if model is None:
            return ()
        decision = find_missing(model, rows, seed=seed)
    except EcmError:  # too few rows, or none that the base determines
        return ()
    if decision.verdict != "named":
        return ()
    return tuple(members[0] for members in decision.answer)
