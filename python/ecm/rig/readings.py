"""One reading as a line of the journal, on disk before the next, and all as a measurement table.

`NAME.journal.csv` holds sensor readings before compensation, which needs the unloaded reading
after them; when the last one is there the table is written and the journal goes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, SPREAD, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta, Scene
from ecm.io.se3 import rotation, turn_wrench
from ecm.io.table import Table
from ecm.rig.calibration import Calibration
from ecm.rig.instruments import Camera, ForceTorqueSensor, Optics, sd_of
from ecm.rig.plan import OFFSET, Skipped, Visit, Visits
from ecm.rig.plant import Plant, wrench_in_base
from ecm.rig.settings import Instruments, RigSettings
from ecm.rig.timeline import Climate, Timeline, stream

_MARK = "# campaign "


def journal_path(out: Path) -> Path:
    """Where the journal of a table lies while it is measured."""
    return out.with_name(out.stem + ".journal.csv")


def raw_path(out: Path) -> Path:
    """Where the raw stream of a table lies."""
    return out.with_suffix(".raw.parquet")


def robot_path(out: Path) -> Path:
    """Where the record of the arm lies beside a table."""
    return out.with_suffix(".robot.json")


BESIDE = {
    ".truth.json": "a sealed truth",
    ".raw.parquet": "a table",
    ".raw.csv": "a table",
    ".raw.toml": "the description of a table",
    ".robot.json": "the record of an arm",
    ".until.json": "the certificate of a run",
}
"""Suffixes of what belongs to a table, and goes when another takes its place."""


def clear_beside(out: Path, keep: Iterable[str]) -> None:
    """Takes away what belonged to the table that was replaced."""
    for suffix in set(BESIDE) - set(keep):
        out.with_suffix(suffix).unlink(missing_ok=True)


def keep_data(out: Path, *, overwrite: bool, resume: bool = True) -> None:
    """Check that no measurement would be overwritten and that the table can be written.

    resume: a campaign that was cut at `out` goes on; whether it is this one `Journal` finds out.

    Raises
    ------
    InputError
        Where a table, or what belongs to one, stands at `out` that no unfinished campaign there
        is about to write and that may not be overwritten, or where `out` is no CSV file.
    """
    if out.suffix != ".csv":
        raise InputError(f"{out}: tables are written as CSV; give a name that ends in .csv")
    if overwrite or (resume and _names_a_campaign(journal_path(out))):
        return
    there = {out: "a table"} | {out.with_suffix(suffix): what for suffix, what in BESIDE.items()}
    for path, what in there.items():
        if path.exists():
            raise InputError(
                f"{path}: {what} stands there, and measurements are not overwritten. Choose "
                "another name, or say --overwrite (in Python: overwrite=True)"
            )


def _names_a_campaign(path: Path) -> bool:
    """Whether there is a journal with a complete first line."""
    with suppress(OSError, UnicodeDecodeError), path.open(encoding="utf-8") as journal:
        first = journal.readline()
        return first.startswith(_MARK) and first.endswith("\n") and len(first) > len(_MARK) + 1
    return False


_OF_COLUMN: dict[str, Callable[[str], object]] = {"visit": int, "row": int, "kind": str}
"""What the cells of columns are that hold no fractions."""


class Journal:
    """Lines of readings in the order of visits, appended and synchronised one by one."""

    def __init__(self, path: Path, key: str, header: str, *, resume: bool) -> None:
        """
        Raises
        ------
        InputError
            Where the journal of another campaign, or one with a damaged line, is at `path`.
        """
        self.path = path
        self._head = f"{_MARK}{key}\n{header}\n"
        self.lines: list[str] = self._read() if resume and path.exists() else []
        self._stream: IO[str] | None = None

    def __enter__(self) -> Journal:
        with on_disk(self.path):
            # Written again, so that a line that was cut in half is gone.
            write_atomically(self.path, self._head + "".join(f"{line}\n" for line in self.lines))
            self._stream = self.path.open("a", encoding="utf-8", newline="")
        return self

    def __exit__(self, *error: object) -> None:
        if self._stream is not None:
            with suppress(OSError):  # of a line that a full disk cut, which `append` told
                self._stream.close()

    def append(self, line: str) -> None:
        """One more reading, on disk when this returns."""
        if self._stream is not None:
            with on_disk(self.path):
                self._stream.write(line + "\n")
                self._stream.flush()
                os.fsync(self._stream.fileno())
        self.lines.append(line)

    def remove(self) -> None:
        """The table is written: the journal has done its work."""
        self.path.unlink(missing_ok=True)

    def _read(self) -> list[str]:
        try:
            text = self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: the journal cannot be read: {error}") from None
        complete = text[: text.rfind("\n") + 1]
        if len(complete) < len(self._head) and self._head.startswith(complete):
            return []
        if not complete.startswith(self._head):
            raise InputError(
                f"{self.path}: this is the journal of another campaign (other plan, rig, seed or "
                "hidden effect), whose readings are in no table yet. Choose another --out, or run "
                "the command of that campaign again"
            )
        names = self._head.splitlines()[1].split(",")
        lines = complete[len(self._head) :].splitlines()
        for number, line in enumerate(lines, 3):
            try:
                for name, cell in zip(names, line.split(","), strict=True):
                    _OF_COLUMN.get(name, float)(cell)
            except ValueError:
                raise InputError(
                    f"{self.path} line {number}: found `{line[:40]}`, expected {len(names)} "
                    "numbers; remove it and all after it, and the same command goes on there"
                ) from None
        return lines


@contextmanager
def on_disk(path: Path) -> Iterator[None]:
    """Say what to do where a disk is full or gone while a reading is written."""
    try:
        yield
    except OSError as error:
        raise ComputationError(
            f"{path}: a reading could not be written: {error}. All readings before it are kept; "
            "free the disk and run the same command again"
        ) from None


_NAMES = (
    *POSE,
    *SPREAD[:6],
    *(f"sensor_{n}" for n in WRENCH),
    *SPREAD[6:],
    "temperature_degC",
    "sensor_temperature_degC",
)
HEADER = ",".join(_NAMES)
"""Header of the journal; `sensor_` columns are in sensor axes and hold the sensor's zero."""


class CampaignState:
    """What of a campaign its table, its raw stream and an injected effect need."""

    plan: Table
    settings: RigSettings
    seed: int
    plant: Plant
    visits: Visits
    timeline: Timeline
    skipped: list[Skipped]
    base_columns: Callable[[F], F] | None
    """(N, 6) poses to the (N, 6, k) change of the wrench per base parameter; None: E alone."""
    frames: Calibration | None
    """Calibrated frames, where the true ones are not known."""
    _air: Climate

    def image(
        self,
        pose: F,
        time_s: float,
        window_s: float,
        random: tuple[np.random.Generator, np.random.Generator],
    ) -> tuple[F, F]:
        """Mean and spread (6,) of what the camera sees of a pose (6,) in a window.

        random: streams of the base target and of the camera.
        """
        walk = self._air.at(self._air.camera, np.array([time_s]))[0]
        camera = Camera(self.settings.instrument)
        mean, spread = camera.read(camera.apparent_pose(pose, walk, random[0]), window_s, random[1])
        if self.frames is not None:
            mean = self.frames.measured(mean[None])[0]
        return mean, spread


@dataclass(frozen=True)
class Reading:
    """Means and spreads of one window."""

    pose: F
    pose_sd: F
    sensor: F
    """In sensor axes, zero included."""
    wrench_sd: F
    """In base axes at the top."""
    temperature_degC: float
    sensor_temperature_degC: float

    @staticmethod
    def of_samples(
        seen: tuple[F, F], sensor: F, top_from_sensor: F, warm_degC: tuple[float, float]
    ) -> Reading:
        """From mean and spread of the pose, samples (n, 6) of the sensor and both temperatures."""
        turn = rotation(seen[0][None, 3:])
        samples = turn_wrench(turn, sensor @ top_from_sensor.T)
        spread = samples.std(axis=0, ddof=1) if len(samples) > 1 else np.zeros(6)
        return Reading(*seen, sensor.mean(axis=0), spread, *warm_degC)

    def line(self) -> str:
        """A line of the journal; numbers read back bit for bit."""
        numbers = [*self.pose, *self.pose_sd, *self.sensor, *self.wrench_sd]
        numbers += [self.temperature_degC, self.sensor_temperature_degC]
        return ",".join(repr(float(n)) for n in numbers)

    @staticmethod
    def parse(line: str) -> Reading:
        """The inverse of `line`."""
        numbers = np.asarray([float(cell) for cell in line.split(",")])
        pose, pose_sd, sensor, wrench_sd = np.split(numbers[:24], 4)
        return Reading(pose, pose_sd, sensor, wrench_sd, float(numbers[24]), float(numbers[25]))


def table_of(campaign: CampaignState, readings: list[Reading], truth_sha256: str) -> Table:
    """The measurement table: wrenches compensated and in base axes, noise of the averaged row."""
    poses = np.stack([r.pose for r in readings])
    sensor = np.stack([r.sensor for r in readings])
    warm = np.asarray([r.sensor_temperature_degC for r in readings])
    wrenches = wrench_in_base(campaign.plant, campaign.visits, sensor, poses, warm)
    visits = campaign.timeline.visits
    rows = [i for i, v in enumerate(visits) if v.kind != OFFSET]
    taken, instrument = [visits[i] for i in rows], campaign.settings.instrument
    noise = [stream(campaign.seed, "stamp", *v.serial).standard_normal() for v in taken]
    time_s = campaign.visits.time_s[rows]
    columns = visit_columns(taken, stamps(instrument, time_s, np.asarray(noise)))
    columns["leds_visible"] = Optics(instrument).visible(poses[rows]).sum(axis=1).astype(np.float64)
    columns |= dict(zip(POSE, poses[rows].T.copy(), strict=True))
    columns |= dict(zip(WRENCH, wrenches[rows].T.copy(), strict=True))
    inputs = campaign.visits.inputs[rows]
    columns |= dict(zip(campaign.plan.actuation_columns, inputs.T.copy(), strict=True))
    columns["temperature_degC"] = np.asarray([readings[i].temperature_degC for i in rows])
    columns["sensor_temperature_degC"] = warm[rows]
    columns |= spread_columns([readings[i] for i in rows])
    skipped = tuple(
        f"row {s.row + 1}, pose {s.pose_id}: skipped: {s.reason}" for s in campaign.skipped
    )
    return Table(columns, described(campaign, truth_sha256), "campaign", skipped)


def visit_columns(visits: Sequence[Visit], time_s: F) -> dict[str, NDArray[Any]]:
    """The columns of a table that say what each of N rows is; time_s (N,)."""
    return {
        "pose_id": np.asarray([v.pose_id for v in visits], dtype=np.float64),
        "run": np.asarray([v.run for v in visits], dtype=np.float64),
        "repeat": np.asarray([v.repeat for v in visits], dtype=np.float64),
        "time_s": time_s,
        "dwell_s": np.asarray([v.dwell_s for v in visits]),
        "approach": np.asarray([v.approach for v in visits], dtype=object),
        "kind": np.asarray([v.kind for v in visits], dtype=object),
    }


def spread_columns(readings: Sequence[Reading]) -> dict[str, NDArray[Any]]:
    """The columns of the standard deviations within each window."""
    spreads = np.stack([[*r.pose_sd, *r.wrench_sd] for r in readings])
    return dict(zip(SPREAD, spreads.T.copy(), strict=True))


def stamps(instrument: Instruments, time_s: F, noise: F) -> F:
    """Time stamps (N,) by the recorder's clock; they grow, as a recorder's do."""
    scatter = instrument.time_stamp_sd_s * noise
    return np.maximum.accumulate((1.0 + instrument.clock_skew) * time_s + scatter)


def described(campaign: CampaignState, truth_sha256: str, window_s: float | None = None) -> Meta:
    """The description of a table whose rows are means over window_s, by default the rig's."""
    settings = campaign.settings
    instrument, plant = settings.instrument, settings.plant
    window = settings.rig.window_s if window_s is None else window_s
    sensor = ForceTorqueSensor(instrument).row_covariance(window, campaign.plant.top_from_sensor)
    position, angle = Camera(instrument).row_sd(window)
    force, torque = sd_of(sensor)
    x, y, z = plant.gravity_m_s2
    known = campaign.plan.meta
    return Meta(
        file=FileMeta(truth_sha256=truth_sha256),
        mechanism=known.mechanism,
        instrument=Instrument(
            pose_position_sd_m=position,
            pose_rotation_sd_rad=angle,
            force_sd_N=force,
            torque_sd_Nm=torque,
            fts_range=instrument.fts_range,
            fts_resolution=instrument.fts_resolution,
            top_from_sensor=instrument.top_from_sensor,
            zeroed_with_payload=instrument.zeroed_with_payload,
        ),
        scene=Scene((x, y, z), plant.payload_mass_kg or None),
        runs=campaign.timeline.runs,
        source=known.source,
    )
