"""Dynamic stiffness and loss angle of a log of sines, measured or as a model has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.io.table import MetaLike, TableLike, takes_table
from ecm.models.fit import as_model
from ecm.models.model import Model
from ecm.regression.blas import one_blas_thread
from ecm.regression.history import order_of_visits
from ecm.report.blocks import Block, Shown, TableBlock

_LEAST_ROWS = 8
"""Fewer rows of a cycle's length tell no sine from another curve."""
_MOST_BESIDE = 0.7
"""Share of the spread of the way that a sine may leave: half of its squares."""


class DynamicStiffness(Shown, dict[str, F]):
    """An array with a value for each run, by name; `print` shows it as a report has it."""

    units = ("mm", "N/mm")
    """Units of the printed way and stiffness; for an angle degrees and N m/rad."""

    def blocks(self) -> list[Block]:
        """Return the table that `print` and a notebook show."""
        way, stiffness = self.units
        factor, per = (1e3, 1e-3) if way == "mm" else (180.0 / np.pi, 1.0)
        kept = [self["frequency_Hz"], factor * self["amplitude"]]
        kept += [per * self[name] for name in ("stiffness", "storage", "loss")]
        kept += [self["loss_angle_deg"], 100.0 * self["rest"]]
        head = ("Hz", way, f"|K*| {stiffness}", "K'", "K''", "delta deg", "no sine %")
        rows = [[float(f"{value:.3g}") for value in row] for row in np.stack(kept, axis=1)]
        return [TableBlock("", head, rows)]

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each run."""
        return require("pandas", "data", "DynamicStiffness.to_pandas").DataFrame(dict(self))


@takes_table("fit")
@one_blas_thread()
def dynamic_stiffness(
    table: TableLike, model: Model | Any = None, *, skip: float = 1.0, meta: MetaLike = None
) -> DynamicStiffness:
    """Complex stiffness of each run of sines: the first harmonic of the load over that of the way.

    K* = K' + i K''; its size is the dynamic stiffness, its angle the loss angle delta.

    Parameters
    ----------
    table
        One pose and one wrench column, `time_s`, and a `run` for each frequency and amplitude.
    model
        None: what was measured. A model: what it predicts for the same motion.
    skip
        Cycles at the start of each run that are left out, in which the start still fades.
    meta
        Description of the table.

    Returns
    -------
    DynamicStiffness
        An array with a value for each run: `run`, `frequency_Hz`, `amplitude` (of the way, m or
        rad), `stiffness` (|K*|), `storage` (K'), `loss` (K''), `loss_angle_deg`, and `rest`, the
        share of the load's spread that is no sine of this frequency. It is a dict that prints.

    Raises
    ------
    InputError
        Columns are missing or too many, a run is shorter than a cycle after those left out, or it
        holds several frequencies.

    Examples
    --------
    >>> t = np.linspace(0.0, 3.0, 301)
    >>> log = {"time_s": t, "x_m": 1e-3 * np.sin(12.0 * t), "fx_N": 5.0 * np.sin(12.0 * t + 0.2)}
    >>> found = dynamic_stiffness(log)
    >>> found["stiffness"].round(3).tolist(), np.deg2rad(found["loss_angle_deg"]).round(4).tolist()
    ([5000.0], [0.2])
    """
    if len(table.pose_columns) != 1 or len(table.wrench_columns) != 1 or not table.has("time_s"):
        raise InputError(
            f"{table.source}: a vibration needs time_s, one pose and one wrench column, found "
            f"{', '.join((*table.pose_columns, *table.wrench_columns))}; leave the others out"
        )
    ways = table.column(table.pose_columns[0])
    loads = table.column(table.wrench_columns[0])
    if model is not None:
        loads = as_model(model, table).readings(table)[:, 0]
    found = []
    for rows in order_of_visits(table):
        time = table.column("time_s")[rows] - table.column("time_s")[rows[0]]
        moved = len(rows) >= _LEAST_ROWS and float(np.ptp(time) * np.ptp(ways[rows])) > 0.0
        frequency = _frequency(time, ways[rows]) if moved else 0.0
        used = rows[time * frequency >= skip]
        number = table.column("run")[rows[0]] if table.has("run") else 0
        if len(used) < _LEAST_ROWS or time[-1] * frequency < skip + 1.0:
            raise InputError(
                f"{table.source}: run {number:g} has {time[-1] * frequency:.2g} cycles, "
                f"{skip + 1.0:g} are needed; record more, or leave out fewer (`skip`)"
            )
        at = table.column("time_s")[used]
        way, other = _harmonic(at, ways[used], frequency)
        if other > _MOST_BESIDE:
            raise InputError(
                f"{table.source}: run {number:g} is no vibration of one frequency, which leaves "
                f"{100.0 * other:.0f} % of the spread of its way; give each frequency a run of its "
                "own: a column that numbers them, `ecm import LOG --map run=COLUMN`"
            )
        load, rest = _harmonic(at, loads[used], frequency)
        k = load / way
        found.append(
            (number, frequency, abs(way), abs(k), k.real, k.imag, np.angle(k, deg=True), rest)
        )
    names = "run frequency_Hz amplitude stiffness storage loss loss_angle_deg rest"
    made = DynamicStiffness(zip(names.split(), np.array(found).T, strict=True))
    if table.pose_columns[0].endswith("_rad"):
        made.units = ("deg", "N m/rad")
    return made


def _harmonic(time: F, values: F, frequency: float) -> tuple[complex, float]:
    """Complex amplitude of a sine of a frequency, and the share of the spread that it leaves."""
    turn = np.exp(2j * np.pi * frequency * time)
    waves = np.stack([turn.real, turn.imag, np.ones(len(time))], axis=1)
    a, b, mean = np.linalg.lstsq(waves, values, rcond=None)[0]
    left = values - waves @ [a, b, mean]
    return complex(a, -b), float(left.std() / max(values.std(), 1e-300))


def _frequency(time: F, way: F) -> float:
    """The frequency whose sine leaves least of a way."""
    even = np.linspace(0.0, time[-1], len(time))
    size = np.abs(np.fft.rfft(np.interp(even, time, way - way.mean())))
    step = 1.0 / time[-1]
    guess = step * max(int(np.argmax(size)), 1)
    around = (max(guess - step, 0.3 * step), guess + step)
    found = minimize_scalar(lambda f: _harmonic(time, way, f)[1], bounds=around, method="bounded")
    return float(found.x)
