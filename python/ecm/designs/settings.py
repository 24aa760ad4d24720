"""Settings of a design, and the row lists and regions that it reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ecm._native import criteria, rows_inside
from ecm._native import row_list as rows_listed
from ecm.effects import Effect
from ecm.errors import DesignError, InputError
from ecm.io.arrays import I
from ecm.io.columns import POSE
from ecm.io.settings import Checked, setting
from ecm.io.table import Table


def row_list(option: str, text: str, count: int) -> I:
    """Rows (from 0) of a list that counts data rows from 1."""
    try:
        return np.asarray(rows_listed(text, count), dtype=np.int64)
    except DesignError as error:
        raise InputError(f"{option}: {error}") from None


def list_or_region(option: str, text: str, table: Table) -> I:
    """Rows (from 0) that a list names or that lie in a region of the pose columns."""
    if not set("<>=") & set(text):
        return row_list(option, text, len(table))
    names = list(table.pose_columns)
    try:
        rows = rows_inside(text, names, np.ascontiguousarray(table.matrix(names)))
    except DesignError as error:
        raise InputError(f"{option}: {error}") from None
    return np.asarray(rows, dtype=np.int64)


CRITERIA = {name: meaning for name, meaning, _ in criteria()}
"""Criteria by name, with what a design's sentence says of them."""

AVERAGED = tuple(name for name, _, averaged in criteria() if averaged)
"""Criteria that average over a region."""


@dataclass(frozen=True)
class DesignSettings(Checked):
    """What a design is for and how it is searched.

    Parameters
    ----------
    criterion
        d: largest determinant; i: smallest average variance of h and of K times half the range;
        a: smallest summed variance of the coefficients; g: smallest largest variance; di: D in
        `share`, I in the rest; maximin: largest smallest distance, in coordinates normalised to
        [-1, 1] or in metres with `metres_per_radian`.
    model
        `poly:D` or its aliases, `energyD` with its length, or `physics` with a nominal model.
    length_m
        Length of the mechanism in m, for energy models; by default that of the nominal model.
    effects
        Effects whose parameters the design determines too, as far as the poses can.
    ridge
        Information known beforehand on every coefficient but a polynomial's constant, in units of
        the rows' information: the design for a ridge fit (Bayesian D, I, A).
    share
        Share of D in the criterion di.
    metres_per_radian
        Length in m that counts as much as a radian in distances; None: normalised coordinates.
    columns
        Names of the pose columns, for `metres_per_radian`.
    replicates
        Whether a pose may be chosen more than once.
    method
        search: the best that is found; paper: Fedorov's exchange for d, simple exchange for
        maximin.
    starts, iterations, time_limit_s
        Random starts; iterations of the search (0: until nothing improves); its limit in s (0:
        none; with a limit another run may give another design).
    seed, threads
        Seed of the random generator; threads (0: all).

    Raises
    ------
    InputError
        A value outside its range.

    Examples
    --------
    >>> DesignSettings(criterion="maximin", starts=3).criterion
    'maximin'
    """

    criterion: str = setting("d", choices=tuple(CRITERIA), doc="Criterion of the design.")
    model: str = setting("cubic", doc="Model that the design is for.")
    length_m: float | None = setting(None, above=0.0, doc="Length of the mechanism in m.")
    effects: tuple[Effect, ...] = setting((), any_size=True, doc="Effects to be determined.")
    ridge: float = setting(0.0, low=0.0, doc="Information known beforehand; 0: none.")
    share: float = setting(0.5, low=0.0, high=1.0, doc="Share of D in the criterion di.")
    metres_per_radian: float | None = setting(None, above=0.0, doc="Metres for a radian.")
    columns: tuple[str, ...] = setting(POSE, any_size=True, doc="Names of the pose columns.")
    replicates: bool = setting(False, doc="Whether a pose may be chosen more than once.")
    method: Literal["search", "paper"] = setting(
        "search", choices=("search", "paper"), doc="Search of the design."
    )
    starts: int = setting(10, low=1, doc="Random starts; the best one is kept.")
    iterations: int = setting(0, low=0, doc="Iterations; 0: until nothing improves.")
    time_limit_s: float = setting(0.0, low=0.0, doc="Time limit of the search in s; 0: none.")
    seed: int = setting(0, doc="Seed of the random generator.")
    threads: int = setting(0, low=0, doc="Threads; 0: all.")
