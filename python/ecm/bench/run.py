"""A plan measured row by row through devices, by the run engine of Bluesky.

Every reading is in NAME.journal.csv before the next move begins. A run that was cut goes on after
the last of them: the sensor's zero is read again, and the rest pose is looked at.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.devices import Device, DeviceError, closed
from ecm.bench.measured import STREAM_HEADER, THE_END, Run, Taken, stream_of, table_of
from ecm.bench.messages import Messages, Status, Stopped
from ecm.bench.settings import ALL, Bench
from ecm.bench.until import NAMED, Goal, Until, certify
from ecm.designs.next_pose import UNITS
from ecm.errors import ComputationError, InputError, Remedy
from ecm.io.arguments import check_arguments, path_of
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE
from ecm.io.events import told_beside
from ecm.io.extras import require
from ecm.io.interrupts import telling
from ecm.io.table import Table
from ecm.rig.plan import OFFSET, requests, rest_pose, split_by_limits, tell_begun
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.readings import HEADER, Journal, clear_beside, journal_path, keep_data, raw_path
from ecm.rig.timeline import Layout, timeline_of

_ENDS_S = 2.0
"""Seconds for which an interrupted run may finish the reading that is under way."""


def envelope(plan: Table, bench: Bench) -> tuple[Run, list[str]]:
    """Lay a plan out and say where it goes, before anything moves.

    Returns
    -------
    Run, list of str
        The visits, and the lines that a person reads before the first move.

    Raises
    ------
    InputError
        A plan without a length, a pose or an actuator beyond the limits, or a person or actuators
        that are needed and not there.
    """
    length = plan.meta.length_m
    if length is None and POSE[0] in bench.columns:
        raise InputError(f"{plan.source}: its TOML names no [mechanism] length_m; add it")
    length = length or 1.0  # of a table without x, where it is nowhere seen
    plan = _filled(plan, bench, length)
    if plan.actuation_columns and "actuation" not in bench.devices:
        raise InputError(
            f"{bench.where}: {plan.source} has {', '.join(plan.actuation_columns)}, and there is "
            "no [actuation] to set them; add that table (docs/measure.md)"
        )
    procedure, limits = bench.procedure, bench.limits
    rest = rest_pose(length, len(plan.actuation_columns))
    visited, skipped = split_by_limits(requests(plan, procedure, length), procedure, length)
    timeline = timeline_of(visited, procedure, length)  # of the plan's own order
    poses = np.stack([visit.pose for visit in timeline.visits])
    for visit in timeline.visits:
        for point in visit.way:
            breach = limits.pose_breach(point, rest) or limits.actuation_breach(point[6:])
            if breach:
                raise InputError(
                    f"{plan.source} row {visit.row + 1}: {breach} of [limits]. Take the row out, "
                    "or raise the limit where the mechanism and the mover bear it"
                )
    zeros = procedure.offset_compensation != "none"
    by_person = next((r for r in visited if r.action.name not in ("measure", "home")), None)
    if (zeros or by_person) and "person" not in bench.devices:
        remedy = Remedy('or add the table [person] with device = "manual"')
        if by_person:
            raise InputError(
                f"{plan.source} row {by_person.row + 1}: `{by_person.action.name}` is done by "
                f"hand, and {bench.where} has no [person]; take the row out",
                remedy=remedy,
            )
        raise InputError(
            f"{bench.where}: the sensor's zero is read with the sensor freed, and there is no "
            '[person] to free it; set [rig] offset_compensation = "none" where it is zeroed before',
            remedy=remedy,
        )
    if procedure.offset_compensation == "temperature" and "thermometer" not in bench.devices:
        raise InputError(
            f'{bench.where} [rig]: offset_compensation = "temperature" needs the sensor\'s '
            'temperature, and there is no [thermometer]; add that table, or set "linear"'
        )
    driven = poses[:, 6:]
    unread = 0 if zeros else sum(visit.kind == OFFSET for visit in timeline.visits)
    seconds = timeline.end_s - unread * (2.0 * procedure.unload_s + procedure.offset_window_s)
    lines = [
        f"{len(timeline.visits) - unread} visits, about {seconds / 60.0:.0f} minutes",
        *(
            f"{name:12s} {1e3 * column.min():8.2f} to {1e3 * column.max():8.2f} "
            + ("mm" if name.endswith("_m") else "mrad")
            for name, column in zip(POSE, poses[:, :6].T, strict=True)
            if name in bench.columns
        ),
        *(
            f"{name:12s} {column.min():8g} to {column.max():8g} {name.rpartition('_')[2]}, "
            f"limits {limits.actuation[0]:g} to {limits.actuation[1]:g}"
            for name, column in zip(plan.actuation_columns, driven.T, strict=True)
        ),
    ]
    if skipped:
        first = f"the first is row {skipped[0].row + 1}: {skipped[0].reason}"
        lines.append(f"{len(skipped)} of {len(plan)} rows are left out, {first}")
    if any(request.offset is not None for request in visited):
        lines.append(
            "each row of the plan is an offset from the pose to which the follower goes"
            if "follower" in bench.devices
            else "there is no [follower]: the poses are those of the plan"
        )
    shift = 1e3 * np.linalg.norm(poses[:, :3] - rest[:3], axis=1).max()
    turn = np.linalg.norm(poses[:, 3:6], axis=1).max()
    lines.append(
        f"farthest {shift:.2f} mm and {turn:.3f} rad from rest; limits {1e3 * limits.shift_m:g} mm "
        f"and {limits.rotation_rad:g} rad, {limits.force_N:g} N and {limits.torque_Nm:g} N m"
    )
    layout = Layout(procedure, length, visited)
    run = Run(bench, visited, layout, len(timeline.visits), skipped)
    run.ways = np.concatenate([visit.way for visit in timeline.visits])
    run.poses = poses[[visit.kind == AT_POSE for visit in timeline.visits]]
    run.plan_s = timeline.visits[-2].time_s
    return run, lines


def pictured(run: Run, out: Path) -> str:
    """Draw where a plan goes beside its table, and say where the picture is."""
    path, limits = out.with_suffix(".envelope.svg"), run.bench.limits
    text = envelope_svg(
        run.ways,
        run.poses,
        run.layout.rest,
        shift_m=limits.shift_m,
        rotation_rad=limits.rotation_rad,
        columns=run.bench.columns,
    )
    write_atomically(path, text)
    return f"{path} shows the poses, the ways and the limits"


def _filled(plan: Table, bench: Bench, length_m: float) -> Table:
    """A plan with all coordinates: those that the rig does not measure stay at rest."""
    missing = {
        name: np.full(len(plan), at)
        for name, at in zip(POSE, rest_pose(length_m), strict=True)
        if name not in bench.columns and not plan.has(name)
    }
    return plan.with_columns(missing) if missing else plan


def measure(  # noqa: PLR0913 - each is a choice of its own
    plan: Table,
    bench: Bench,
    out: str | Path,
    *,
    minutes: float | None = None,
    model: Any = None,
    until: str = "",
    fit: str = "",
    seed: int = 0,
    agree: Callable[[list[str]], object] | None = None,
    resume: bool = True,
    overwrite: bool = False,
    devices: Mapping[str, Device] | None = None,
    say: Callable[[str], None] = print,
    progress: Callable[[int, int, str], object] | None = None,
) -> Table:
    """Measure a plan on a real rig.

    Parameters
    ----------
    plan
        Poses in visiting order, as `ecm design` writes them; its TOML names the length.
    bench
        Limits, instruments and devices.
    out
        Table to write, NAME.csv; every reading is in NAME.journal.csv before the next move.
    minutes
        No pose is begun after this time. 0 asks no device: the readings so far become the table.
    model
        A model of pose and wrench: `progress` says how far each row is from it.
    until
        What is enough: an error at fresh poses, `0.3 mm` or `0.5 N`, or `named`. After each row the
        next is that which tells most per minute about it. NAME.until.json says why it stopped.
    fit
        Model whose error counts, such as `energy6`; by default the best of degree 4 to 6. With
        `minutes` and without `until`: what tells most about it until the time is over.
    seed
        Seed of the diagnoses of `named`.
    agree
        Gets the lines of `envelope` before anything moves, when NAME.envelope.svg is drawn; what
        it raises ends the run there. With 0 `minutes` nothing moves, and it is not asked.
    resume
        Go on after the last reading of a run that was cut; False starts again.
    overwrite
        Whether a table that is already at `out` may be replaced.
    devices
        Devices by part, where they are made in Python; default: those of the bench.
    say
        Gets each finding as a line.
    progress
        Called with (done, total, words).

    Returns
    -------
    Table
        One row per reading. Its `warnings` are the findings.

    Raises
    ------
    InputError
        A pose beyond the limits, or a finished table at `out`.
    DeviceError
        A device was silent or refused, or a limit was broken; the mover has been stopped, and
        what was measured is kept.
    MissingExtra
        Without the extra `measure`.

    Examples
    --------
    A finished table is not measured again; docs/measure.md measures a spring.

    >>> from ecm.io.table import as_table
    >>> manual = {part: {"device": "manual"} for part in ("mover", "wrench", "pose", "person")}
    >>> measure(as_table({"x_m": [0.1]}), Bench.from_dict(manual, "bench.toml"), "data.txt")
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: data.txt: tables are written as CSV; give a name that ends in .csv
    """
    check_arguments(measure, locals())
    out = path_of(out)
    keep_data(out, overwrite=overwrite, resume=resume)
    engine_of = require("bluesky.run_engine", "measure", "ecm measure").RunEngine
    run, lines = envelope(plan, bench)
    if until or fit:
        goal = Goal.parse(until) if until else Goal("the end of the plan", "N")
        if goal.unit in UNITS and (bench.columns != ALL or plan.actuation_columns):
            raise InputError(
                f"--until {goal.text}: an error needs all six pose and wrench columns and no "
                "actuators; leave --until out"
            )
        run.chooser = Until(goal, plan, fit, model, seed)
    lines.append(pictured(run, out))
    if agree is not None and minutes != 0.0:
        agree(lines)
    if model is not None:
        _hold_to(run, model, until)
    head = ",".join(["visit,row,kind,time_s", HEADER, *plan.actuation_columns])
    key = _key(plan, bench)
    with ExitStack() as files:
        journal = files.enter_context(Journal(journal_path(out), key, head, resume=resume))
        samples = None
        if bench.procedure.stream_Hz:
            beside = journal_path(out.with_suffix(".raw.csv"))
            samples = files.enter_context(Journal(beside, key, STREAM_HEADER, resume=resume))
        files.enter_context(told_beside(out))
        tell_begun(plan, columns=bench.columns, of=run.total)
        for line in journal.lines:
            taken = Taken.parse(line)
            run.lay_out_to(taken)
            run.told(taken)
        first = 1 + max((taken.number for taken in run.taken), default=-1)

        def keep(taken: Taken) -> list[str]:
            journal.append(taken.line())
            findings = run.told(taken)
            if progress is not None:
                progress(taken.number + 1, run.total, run.words(taken))
            return findings

        # Also of a rig that is broken for good, or of a plan with a pose that it cannot reach.
        ended = run.taken and run.taken[-1].row == THE_END
        if minutes != 0.0 and not ended:
            parts = bench.open() if devices is None else devices
            sample = None if samples is None else samples.append
            _drive(Messages(run, parts, keep, say, minutes, sample), engine_of, run, first, parts)
        if not run.at_poses:
            raise InputError(f"{out}: no pose was measured, so no table is written")
        table = table_of(run, plan, out, run.taken)
        table.write(out)
        clear_beside(out, keep=())
        if samples is not None and samples.lines:
            stream_of(run, plan, samples.lines).write(raw_path(out).with_suffix(".csv"))
            samples.remove()
        certify(run, out)
        journal.remove()
    return table


def _hold_to(run: Run, model: Any, until: str) -> None:
    """Have rows held to a model of six columns; one of fewer is what a name is asked of."""
    if run.bench.columns == ALL and np.shape(model.predict(run.layout.rest[None])) == (1, 6):
        run.model = model
    elif until != NAMED:
        raise InputError(
            "the model or the rig has not all six columns of pose and wrench, by which rows are "
            "compared"
        )


def _drive(
    messages: Messages, engine_of: Any, run: Run, first: int, devices: Mapping[str, Device]
) -> None:
    """Let Bluesky go through the visits; whatever happens, the mover is stopped first."""
    if first:
        messages.told(f"going on at visit {first + 1} of {run.total}")
    # Its errors are raised here and told once.
    logging.getLogger("bluesky").addHandler(logging.NullHandler())
    engine = engine_of({}, context_managers=[])
    work = None
    with ExitStack() as ends:
        for device in {id(device): device for device in devices.values()}.values():
            ends.callback(closed, device)
        ends.enter_context(telling(lambda: f" {messages.mover.words()}."))
        try:
            # In a thread, so that Ctrl-C is raised here and stops the mover, whatever it does.
            work = Status(lambda: engine(messages.rows(first)))
            while not work.done:
                with suppress(TimeoutError):
                    work.exception(0.1)
            error = work.exception()
            if error is not None:
                messages.mover.stop()
                raise _told_error(error, run, messages.mover.words()) from error
        except KeyboardInterrupt:
            stopping = Status(messages.mover.stop)
            messages.told("the mover is being stopped; a second Ctrl-C would not wait for it")
            stopping.exception(None)
            messages.told(messages.mover.words())
            with suppress(TimeoutError):
                work is None or work.exception(_ENDS_S)
            raise


def _told_error(error: BaseException, run: Run, stop: str) -> BaseException:
    """The error with what is kept, where it comes from a device."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, (ComputationError, TimeoutError, OSError)):
        cause = cause.__cause__
    if cause is None:
        return error
    words = str(cause).removesuffix(".") or "a device did not answer in time"
    kind = Stopped if isinstance(cause, Stopped) else DeviceError
    visit = run.taken[-1].number + 2 if run.taken else 1
    return kind(
        f"stopped at visit {visit}: {words}. {stop}, and {len(run.taken)} readings are kept; the "
        "same command goes on there, and with --minutes 0 it writes the table of them"
    )


def _key(plan: Table, bench: Bench) -> str:
    columns = {name: np.asarray(plan.columns[name]).tolist() for name in sorted(plan.columns)}
    document = json.dumps([2, columns, bench.key()], sort_keys=True, default=str)
    return hashlib.sha256(document.encode()).hexdigest()


_SIDE, _MARGIN = 250, 46
_VIEWS = ((0, 1), (1, 2), (3, 4), (4, 5))
"""Pairs of coordinates."""
_INK, _BLUE, _RED = "#1c2430", "#0072b2", "#d55e00"


def envelope_svg(
    ways: F, poses: F, rest: F, *, shift_m: float, rotation_rad: float, columns: Sequence[str]
) -> str:
    """Draw ways (k, 6) and poses (n, 6) round the rest pose (6,), with the limits as circles.

    Parameters
    ----------
    ways, poses
        Every point that the mover passes in its order, and the poses that are measured.
    rest
        The pose at rest.
    shift_m, rotation_rad
        Limits of the distance from rest and of the rotation.
    columns
        Coordinates that are measured: a view of none of them is left out.
    """
    pairs = [pair for pair in _VIEWS if {POSE[i] for i in pair} & {*columns}]
    width = len(pairs) * (_SIDE + _MARGIN) + _MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {_SIDE + 2 * _MARGIN}" '
        f'width="{width}" font-family="sans-serif" font-size="12" fill="{_INK}">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for k, (i, j) in enumerate(pairs):
        unit, factor, limit = ("mm", 1e3, shift_m) if i < 3 else ("rad", 1.0, rotation_rad)
        middle = rest[[i, j]]
        furthest = max(float(np.abs(ways[:, [i, j]] - middle).max()), 1e-6)
        # A limit that is far away would leave the poses as one dot.
        half = 1.15 * (limit if furthest > 0.2 * limit else furthest)
        left = _MARGIN + k * (_SIDE + _MARGIN)

        def dots(points: F, left: int = left, half: float = half, middle: F = middle) -> F:
            place = (points - middle) / half * (0.5 * _SIDE) * [1.0, -1.0]
            shifted: F = place + np.array([left + 0.5 * _SIDE, _MARGIN + 0.5 * _SIDE])
            return shifted

        (x, y), radius = dots(middle), limit / half * 0.5 * _SIDE
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in dots(ways[:, [i, j]]))
        parts += [
            f'<svg x="{left}" y="{_MARGIN}" width="{_SIDE}" height="{_SIDE}" '
            f'viewBox="{left} {_MARGIN} {_SIDE} {_SIDE}">',
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="{_RED}" '
            'stroke-dasharray="6 4"/>',
            f'<polyline points="{line}" fill="none" stroke="{_BLUE}" stroke-width="0.6" '
            'opacity="0.5"/>',
            *(
                f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.6" fill="{_BLUE}"/>'
                for a, b in dots(poses[:, [i, j]])
            ),
            f'<path d="M{x - 6:.1f} {y:.1f}h12M{x:.1f} {y - 6:.1f}v12" stroke="{_INK}"/>',
            "</svg>",
            f'<rect x="{left}" y="{_MARGIN}" width="{_SIDE}" height="{_SIDE}" fill="none" '
            f'stroke="{_INK}" stroke-width="0.6"/>',
            f'<text x="{left}" y="{_MARGIN - 26}">{_title(i, unit)} to the right, '
            f"{_title(j, unit)} up</text>",
            f'<text x="{left}" y="{_MARGIN - 9}">rest in the middle, edge {factor * half:.3g} '
            f"{unit} from it</text>",
        ]
    foot = _SIDE + _MARGIN + 20
    parts += [
        f'<text x="{_MARGIN}" y="{foot}">{len(poses)} poses (dots), the ways (lines), the limit '
        f"(dashed): {1e3 * shift_m:g} mm and {rotation_rad:g} rad</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _title(i: int, unit: str) -> str:
    name = POSE[i].rpartition("_")[0].replace("theta_", "θ")
    return f"{name} [{unit}]"
