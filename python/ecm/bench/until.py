"""`--until`: which row is measured next, when it is enough, and what is promised then.

A row is chosen by what it tells per minute; travel, dwell and window count. A choice depends on the
readings so far alone, so a run that was cut chooses as one that was not.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.measured import Run, described, table_of
from ecm.bench.settings import ALL
from ecm.designs.next_pose import UNITS, NextPose
from ecm.diagnosis.agreement import Look, Told, agreed, is_due, look_at
from ecm.errors import EcmError, InputError
from ecm.io.cache import write_json
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.plan import Request

NAMED = "named"
_ANY_ORDER = ("measure", "home", "unload")
"""Actions that may stand in any order; what else a person does ends a run of the plan."""


@dataclass(frozen=True)
class Goal:
    """What is enough: an error, or a name of what the model lacks.

    Examples
    --------
    >>> Goal.parse("0.3 mm").limit, Goal.parse("named").unit
    (0.3, 'named')
    >>> Goal.parse("3 apples")
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: --until 3 apples: expected an error such as "0.3 mm" or "0.5 N", or named
    """

    text: str
    unit: str
    limit: float = 0.0

    @staticmethod
    def parse(text: str) -> Goal:
        """Read `--until`.

        Raises
        ------
        InputError
            For anything but an error above 0 with its unit, or `named`.
        """
        words = text.strip()
        if words == NAMED:
            return Goal(words, NAMED)
        found = re.fullmatch(r"(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\s*(mm|N)", words)
        limit = float(found[1]) if found else 0.0
        if found is None or not 0.0 < limit < np.inf:
            raise InputError(
                f'--until {text}: expected an error such as "0.3 mm" or "0.5 N", or {NAMED}'
            )
        return Goal(f"{limit:g} {found[2]}", found[2], limit)


class Until:
    """Chooses rows of a plan until a goal is reached.

    Parameters
    ----------
    goal
        What is enough.
    plan
        The rows that can be measured.
    fit
        Model whose error counts, `energyD`; by default that of the least AIC of degree 4 to 6.
    model
        Model that lacks something, for `named`; by default an energy fitted to the rows, or, with
        few columns or with actuators, what predicts held-out rows of them best.
    seed
        Seed of the diagnosis.

    Raises
    ------
    InputError
        Where the plan has actions that cannot be put in another order.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> plan = as_table({"x_m": [0.1], "action": ["remount:90"]})
    >>> Until(Goal.parse("named"), plan)
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: row 1: --until takes the rows in another order, and after `remount:90` \
the rig is another; take this row out, and measure it with a plan of its own
    """

    def __init__(
        self, goal: Goal, plan: Table, fit: str = "", model: Model | None = None, seed: int = 0
    ) -> None:
        self.goal, self._plan = goal, plan
        words, kinds = plan.text("action"), plan.text("kind")
        for row, word in enumerate(words):
            if word.partition(":")[0] not in ("", *_ANY_ORDER):
                raise InputError(
                    f"row {row + 1}: --until takes the rows in another order, and after `{word}` "
                    "the rig is another; take this row out, and measure it with a plan of its own"
                )
        self.reached = False
        self._poses: NextPose | None = None
        self._place: dict[int, int] = {}
        self._seed, self._model = seed, model
        self._looks: dict[int, Look] = {}
        if goal.unit in UNITS:
            moves = np.isin(words, ["", "measure"]) & np.isin(kinds, ["", AT_POSE])
            self._place = {row: i for i, row in enumerate(np.flatnonzero(moves).tolist())}
            self._poses = NextPose(plan.select(moves), goal.unit, fit)

    def choose(self, run: Run, left: list[Request]) -> list[Request]:
        """Rows in the order in which they tell most; empty where it is enough."""
        if self._poses is not None:
            return self._for_error(run, left, self._poses)
        return self._for_name(run)

    def _for_error(self, run: Run, left: list[Request], poses: NextPose) -> list[Request]:
        waiting = {self._place[r.row]: r for r in left if r.action.name == "measure"}
        if run.at_poses:
            poses.learn(self._poses_of(run))
        self.reached = poses.error is not None and poses.error.high <= self.goal.limit
        if self.reached or not waiting:
            return []
        minutes = np.asarray([run.layout.minutes(r) for r in waiting.values()])
        return [waiting[i] for i in poses.order([*waiting], minutes).tolist()]

    def _for_name(self, run: Run) -> list[Request]:
        at = run.at_poses
        due = [n for n in range(len(at), 0, -1) if is_due(n)]
        self.reached = agreed(self._look(run, at[n - 1], n) for n in due)
        told = self._look(run, at[due[0] - 1], due[0]).told if due else None
        over = self.reached or run.is_over
        row = None if over else next_row(run.requests, run.order, told, run.layout.minutes)
        return [] if row is None else [row]

    def _look(self, run: Run, last: int, poses: int) -> Look:
        """The diagnosis of the readings up to one."""
        if poses not in self._looks:
            rows = table_of(run, self._plan, Path("so far"), run.taken[: last + 1])
            model = self._model
            if model is None and (run.bench.columns != ALL or self._plan.actuation_columns):
                model = _chosen(rows.measured())
            self._looks[poses] = look_at(rows, self._plan, model, self._seed)
        return self._looks[poses]

    def _poses_of(self, run: Run) -> Table:
        """Poses and wrenches so far: the zeros since change those that were read before them."""
        at = run.at_poses
        poses = np.stack([run.taken[i].reading.pose for i in at])
        columns = run.columns(poses, run.wrenches(run.taken)[at])
        return Table(columns, described(run, self._plan), "so far")

    @property
    def names(self) -> tuple[str, ...]:
        """What the last diagnosis named."""
        return self._looks[max(self._looks)].names if self._looks else ()

    def state(self) -> dict[str, Any]:
        """How far the goal is."""
        known = {"text": self.goal.text, "reached": self.reached}
        if self._poses is None:
            return known | {"names": list(self.names)}
        return known | {"error": self._poses.error and asdict(self._poses.error)}

    def words(self) -> list[str]:
        """The same for people."""
        if self._poses is None:
            return [f"named {', '.join(self.names)}"] if self.names else []
        return [self._poses.error.sentence()] if self._poses.error is not None else []

    def certificate(self, run: Run) -> dict[str, Any]:
        """Why the run stopped, and what is promised, of all readings."""
        count = len(run.at_poses)
        minutes = (run.taken[-1].time_s - run.taken[0].time_s) / 60.0
        if self._poses is not None:
            self._poses.learn(self._poses_of(run))
        if self.reached:
            why = f"{self.goal.text} was reached"
        elif run.left() or self._poses is None:
            why = f"the time was over before {self.goal.text}"
        else:
            why = f"the plan has no more rows, and {self.goal.text} was not reached"
        words = [f"stopped after {count} poses and {minutes:.0f} minutes: {why}", *self.words()]
        error = None if self._poses is None else self._poses.error
        if error is not None and error.lacks_form and not self.reached:
            words.append(
                f"{error.model} lacks form: its residual holds more than the readings' noise. No "
                "further row helps it; ecm diagnose says what is missing"
            )
        return {"schema": 1, "rows": count, "minutes": minutes, "words": words} | self.state()


def _chosen(rows: Table) -> Model | None:
    """The model of rows that no energy of the pose alone describes; None with too few of them."""
    with suppress(EcmError):
        return fit_model(rows, "choose", force=True)
    return None


def next_row(
    requests: Sequence[Request],
    order: Sequence[int],
    told: Told | None,
    minutes: Callable[[Request], float],
) -> Request | None:
    """Return the next row of a plan, which may have been measured before; None without a pose.

    Every other pose is the one that tells most per minute. By that alone short rests come first and
    long ones late, and what grows with time looks like what grows with rest; so the others are from
    the plan, whose order is random, again and again: of any time as many of each kind as it takes
    less. Looks at the rest pose stay after as many poses as in the plan. The sensor's zero is left
    to the run, which reads it of itself.

    Parameters
    ----------
    requests
        The rows of the plan, in its order.
    order
        Rows as they were gone to; those that no plan asked for are below 0.
    told
        What rows tell by the last diagnosis that was due.
    minutes
        Gives the time that a row takes.
    """
    taken = Counter(order)
    poses = [one for one in requests if one.action.name == "measure"]
    rows = {one.row for one in poses}
    places = [i for i, row in enumerate(order) if row in rows]
    before = 0
    for one in requests:
        before += one.row in rows
        if one.action.name == "home" and before + len(poses) * taken[one.row] <= len(places):
            return one
    if not poses:
        return None
    last = max((n for n in range(len(places) + 1) if is_due(n)), default=0)
    takes = np.asarray([minutes(one) for one in poses])
    if told is None or (len(places) - last) % 2:
        turns = len(poses) * np.asarray([taken[one.row] for one in poses])
        return poses[int(np.argmin((turns + np.arange(1, len(poses) + 1)) * takes))]
    since = [row for row in order[places[last - 1] + 1 :] if row >= 0]
    return poses[int(np.argmax(told.worth([one.row for one in poses], since) / takes))]


def certificate_path(out: Path) -> Path:
    """Where the certificate of a table lies."""
    return out.with_suffix(".until.json")


def certify(run: Run, out: Path) -> None:
    """Write the certificate of a run that chose its rows."""
    if isinstance(run.chooser, Until):
        write_json(certificate_path(out), run.chooser.certificate(run))
