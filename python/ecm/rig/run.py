"""`ecm campaign`: a plan and a rig file become a table on disk; one plan on many rigs.

`NAME.csv` becomes `NAME-0000.csv`, `NAME-0001.csv`, ..., each with all files of a table.
`NAME.rigs.json` holds which of them are this job's own and which are done: a table that is there
under the same settings is not measured again, one that somebody else put there is not overwritten,
and a kill loses at most the rigs that were under way.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.cache import cache_directory, write_atomically, write_json
from ecm.io.events import tell
from ecm.io.extras import dask_client, dask_completed, require_pyarrow, write_parquet
from ecm.io.mesh import mesh_bytes
from ecm.io.table import Table, read_table
from ecm.rig import truth
from ecm.rig.arm.trips import extra_s
from ecm.rig.campaign import Campaign
from ecm.rig.elastic import FemSource, Progress, Source
from ecm.rig.plan import requests, split_by_limits, tell_begun
from ecm.rig.readings import (
    HEADER,
    Journal,
    Reading,
    clear_beside,
    journal_path,
    keep_data,
    raw_path,
    robot_path,
)
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import timeline_of
from ecm.rig.truth import NOTHING, Hidden

_NO_STREAM = (
    "[rig] stream_Hz: the raw stream is stored beside a table on disk only; give `out`, or ask "
    "Campaign.raw_stream for it"
)


@dataclass(frozen=True)
class CampaignOptions:
    """How campaigns are run; nothing here changes a reading.

    Parameters
    ----------
    resume
        Continue the journal of a campaign that was cut; False starts again.
    threads
        Threads of the FEM solver; 0: all cores.
    source
        Solves the mechanism; default FEM of the plan's `[mechanism]`.
    folder
        Folder of the solved poses; default the user's cache.
    scheduler
        Address of a Dask scheduler for many rigs; default: one after the other, on this machine.

    Examples
    --------
    >>> CampaignOptions(threads=2).resume
    True
    """

    resume: bool = True
    threads: int = 0
    source: Source | None = None
    folder: Path | None = None
    scheduler: str | None = None


def run_campaign(
    plan: Table,
    rig: RigSettings,
    out: Path | None = None,
    *,
    hide: str | Sequence[Hidden] | None = None,
    seed: int = 0,
    progress: Progress = None,
    overwrite: bool = False,
    options: CampaignOptions | None = None,
) -> Table:
    """Run a plan on the simulated rig.

    Parameters
    ----------
    plan
        Poses in visiting order; its TOML names the `[mechanism]`.
    rig
        Settings of the rig.
    out
        Table to write, with NAME.toml and NAME.truth.json beside it; every reading is in
        NAME.journal.csv before the next one is taken (of the arm, every trip in
        NAME.journal.parts). None: in memory, without the raw stream.
    hide
        `EFFECT=S`, `random`, several with commas, or parsed; goes before the rig's `[hidden]`.
    seed
        Seed of the random generator.
    progress
        Called with (done, total, what).
    overwrite
        Whether a table that is already at `out` may be replaced.
    options
        Resuming, threads, solver and cache.

    Returns
    -------
    Table
        One row per reading. Its `warnings` name the poses that were skipped, with the reason, and
        a raw stream without a file.

    Raises
    ------
    InputError
        A finished table is already at `out`, or the journal of another campaign.

    Examples
    --------
    Two poses of the paper's neck, solved by FEM, in memory.

    >>> from ecm.io.columns import POSE
    >>> from ecm.io.description import Meta
    >>> from ecm.io.mechanism import Mechanism
    >>> from ecm.io.table import as_table
    >>> poses = dict.fromkeys(POSE, [0.0, 0.0]) | {"x_m": [0.1034, 0.102]}
    >>> plan = as_table(poses, meta=Meta(mechanism=Mechanism().to_dict()))
    >>> len(run_campaign(plan, RigSettings()))
    2
    """
    check_arguments(run_campaign, locals())
    options = options or CampaignOptions()
    resume, folder = options.resume, options.folder or cache_directory()
    require_possible(rig, out, overwrite=overwrite, resume=resume)
    tell_begun(plan)  # who follows sees the plan while its forces are computed
    source = options.source or fem_source(plan, options.threads)
    if hide is None:
        hide = rig.hidden.effect
        if hide and hide != NOTHING:
            hide = f"{hide}={rig.hidden.strength!r}"
    if isinstance(hide, str):
        hide = Hidden.parse(hide)
    kind: type[Campaign] = Campaign
    if rig.rig.mode == "robot":
        from ecm.rig.arm.campaign import RobotCampaign, require_arm  # noqa: PLC0415 - it takes 1.5 s to load

        require_arm(folder)
        kind = RobotCampaign
    campaign = kind(plan, rig, source, hide=hide, seed=seed, folder=folder, progress=progress)
    raw = campaign.raw_stream()  # where a plan has too few poses for one it is said now
    if out is None:
        table = campaign.run(options.threads, progress)
        return table if raw is None else replace(table, warnings=(*table.warnings, _NO_STREAM))
    path = journal_path(out)
    parts = path.with_suffix(".parts")
    with Journal(path, campaign.key(source), HEADER, resume=resume) as journal:
        campaign.drive(options.threads, progress, parts)
        readings = []
        for i, visit in enumerate(campaign.timeline.visits):
            new = i == len(journal.lines)
            if new:
                journal.append(campaign.measure(i).line())
            readings.append(Reading.parse(journal.lines[i]))
            pose, sensor = readings[i].pose.tolist(), readings[i].sensor.tolist()
            tell(measured={"visit": i + 1, "kind": visit.kind, "pose": pose, "wrench": sensor})
            if new and progress is not None:
                progress(i + 1, len(campaign), "measuring")
    if raw is not None:
        stream = raw.table(campaign, readings)
        write_parquet(stream.columns, stream.meta.applied().to_toml(), raw_path(out))
    table = _written(campaign, campaign.table(readings), out)
    shutil.rmtree(parts, ignore_errors=True)
    journal.remove()
    return table


def require_possible(
    rig: RigSettings, out: Path | None, *, overwrite: bool, resume: bool = True
) -> None:
    """InputError or MissingExtra, before the work, where it could not be written."""
    if out is not None:
        keep_data(out, overwrite=overwrite, resume=resume)
    if not rig.rig.stream_Hz:
        return
    if rig.rig.mode == "robot":
        raise InputError(
            "[rig] stream_Hz: the arm keeps no raw stream, only the quasi-static rig does. Set "
            'mode = "quasi_static", or stream_Hz = 0'
        )
    if out is not None:
        require_pyarrow(f"[rig] stream_Hz writes {raw_path(out)}, which")


def _written(campaign: Campaign, table: Table, out: Path) -> Table:
    """The table on disk, and the truth beside it where something was hidden."""
    table = replace(table, source=str(out))
    text = campaign.truth_text()
    own = [".raw.parquet", ".raw.toml"] if campaign.settings.rig.stream_Hz else []
    record = campaign.record()
    if record is not None:
        write_json(robot_path(out), record)
        own.append(".robot.json")
    if text is not None:
        write_atomically(truth.truth_path(out), text)
        own.append(".truth.json")
    clear_beside(out, own)
    table.write(out)
    return table


def campaign_minutes(plan: Table, rig: RigSettings) -> float:
    """Time that a plan takes on the rig, before anything is solved.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> from ecm.io.description import Meta
    >>> plan = as_table({
    ...     "x_m": [0.1, 0.1], "y_m": [0.0, 0.002], "z_m": [0.0, 0.0],
    ...     "theta_x_rad": [0.0, 0.0], "theta_y_rad": [0.0, 0.0], "theta_z_rad": [0.1, 0.2],
    ... }).with_meta(Meta(mechanism={"length_m": 0.1}))
    >>> f"{campaign_minutes(plan, RigSettings()):.2f} min"
    '6.17 min'
    """
    length = plan.meta.length_m
    if length is None:
        raise InputError(f"{plan.source}: its TOML names no [mechanism] length_m; add it")
    inside, _ = split_by_limits(requests(plan, rig.rig, length), rig.rig, length)
    planned = timeline_of(inside, rig.rig, length)
    seconds = planned.end_s
    if rig.rig.mode == "robot":
        seconds += sum(extra_s(v, rig.rig) for v in planned.visits)
    return seconds / 60.0


def fem_source(plan: Table, threads: int = 0) -> Source:
    """FEM of the mechanism that a plan's TOML names.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> from ecm.io.description import Meta
    >>> body = {"builtin": "cylinder", "length_m": 0.1, "radius_m": 0.03, "young_modulus_Pa": 6.5e5}
    >>> plan = as_table({"x_m": [0.1], "y_m": [0.0]}).with_meta(Meta(mechanism=body))
    >>> fem_source(plan).length_m
    0.1
    """
    body = plan.meta.elastic_body()
    if body is None:
        raise InputError(
            f"{plan.source}: its TOML names no [mechanism] that FEM could solve; add builtin, its "
            "dimensions and young_modulus_Pa, as `ecm design` copies them from the candidates"
        )
    return FemSource(body, threads=threads)


def ledger_path(out: Path) -> Path:
    """What a campaign on many rigs has done so far."""
    return out.with_name(f"{out.stem}.rigs.json")


def rig_paths(out: Path, rigs: int) -> list[Path]:
    """The tables of so many rigs."""
    return [out.with_name(f"{out.stem}-{i:04d}{out.suffix}") for i in range(rigs)]


def run_campaigns(
    plan: Table,
    rig: RigSettings,
    out: Path,
    *,
    seeds: range,
    hide: str | None = None,
    progress: Progress = None,
    overwrite: bool = False,
    options: CampaignOptions | None = None,
) -> list[Path]:
    """Measure a plan on many rigs, each with a seed of its own.

    Parameters
    ----------
    plan
        Poses in visiting order; its TOML names the `[mechanism]`, which FEM solves.
    rig
        Settings of every rig.
    out
        `NAME.csv`: the tables are `NAME-0000.csv`, `NAME-0001.csv`, ...
    seeds
        Seed of the random generator of each rig, such as `range(100)`.
    hide
        As in `run_campaign`; `random` draws for each rig.
    progress
        Called with (done, total, "rigs").
    overwrite
        Whether tables of other settings, or of another job, may be replaced.
    options
        Threads, and the scheduler where the rigs run on Dask workers.

    Returns
    -------
    list of Path
        The tables, in the order of the seeds.

    Raises
    ------
    InputError
        Seeds with gaps, no scheduler at the address, or tables of other settings at `out`.

    Examples
    --------
    The number of rigs is that of the seeds; a step between seeds is refused.

    >>> from ecm.io.table import as_table
    >>> plan = as_table({"x_m": [0.1, 0.1], "y_m": [0.0, 0.002]})
    >>> run_campaigns(plan, RigSettings(), Path("data.csv"), seeds=range(0, 10, 2))
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: seeds = range(0, 10, 2): found steps of 2, expected a range without
    """
    if seeds.step != 1:
        raise InputError(f"seeds = {seeds}: found steps of {seeds.step}, expected a range without")
    options = options or CampaignOptions()
    if options.source is not None or options.folder is not None or not options.resume:
        raise InputError(
            "run_campaigns: each rig is solved by the FEM of its plan, keeps poses in the user's "
            "cache, and goes on by itself; leave out source, folder and resume of its options"
        )
    rigs, seed, threads = len(seeds), seeds.start, options.threads
    paths = rig_paths(out, rigs)
    meta, mesh = plan.meta.beside(out), _relative_mesh(plan, out)
    key = _key(plan, rig, hide, seed, mesh)
    own, done = _ledger(ledger_path(out), key, overwrite=overwrite)

    def save() -> None:
        document = {"key": key, "own": sorted(own), "done": sorted(done)}
        write_atomically(ledger_path(out), json.dumps(document))

    for i, path in enumerate(paths):
        # A journal that is there is a single campaign's, never this job's.
        keep_data(path, overwrite=overwrite or i in own, resume=False)
    numbers = set(range(rigs))
    if overwrite and done >= numbers:
        done -= numbers  # nothing is unfinished: all of it is to be measured again
    own |= numbers
    save()
    open_ = [i for i, path in enumerate(paths) if i not in done or not path.exists()]
    settings = rig.to_dict()
    text = _csv(plan)

    def finished(i: int, files: dict[str, bytes]) -> None:
        for suffix, content in sorted(files.items()):
            write_atomically(paths[i].with_suffix(suffix), content)
        clear_beside(paths[i], files)
        done.add(i)
        save()
        if progress is not None:
            progress(len(done & numbers), rigs, "rigs")

    work = ((i, (text, meta.to_toml(), mesh, settings, hide, seed + i, threads)) for i in open_)
    if options.scheduler is None:
        for i, arguments in work:
            finished(i, measured_files(*arguments))
    else:
        _on_workers(options.scheduler, work, finished)
    return paths


def measured_files(
    plan: str,
    meta: str,
    mesh: tuple[str, bytes] | None,
    settings: dict[str, Any],
    hide: str | None,
    seed: int,
    threads: int,
) -> dict[str, bytes]:
    """The files of one campaign by suffix; everything comes and goes as text, to any machine.

    `mesh` is the mesh file as seen from the tables, and its content.
    """
    with tempfile.TemporaryDirectory() as root:
        name, content = mesh or ("", b"")
        # So deep that a mesh file above the tables is still within the temporary folder.
        folder = Path(root, *("d" for part in Path(name).parts if part == ".."))
        folder.mkdir(parents=True, exist_ok=True)
        if mesh is not None:
            path = Path(os.path.normpath(folder / name))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        source = folder / "plan.csv"
        source.write_text(plan, encoding="utf-8")
        source.with_suffix(".toml").write_text(meta, encoding="utf-8")
        table = read_table(source, need="predict")
        out = folder / "data.csv"
        rig = RigSettings.from_dict(settings)
        run_campaign(
            table, rig, out, hide=hide, seed=seed, options=CampaignOptions(threads=threads)
        )
        beside = {path.name.removeprefix(out.stem): path for path in out.parent.glob("data.*")}
        return {suffix: path.read_bytes() for suffix, path in beside.items()}


def _csv(plan: Table) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.csv"
        plan.write(path)
        return path.read_text(encoding="utf-8")


def _relative_mesh(plan: Table, out: Path) -> tuple[str, bytes] | None:
    """The plan's relative mesh file as seen from the tables, and its content."""
    name = plan.meta.beside(out).mechanism.get("mesh")
    if name is None or Path(name).is_absolute():
        return None
    return name, mesh_bytes(Path(plan.meta.absolute_mechanism()["mesh"]))


def _key(
    plan: Table, rig: RigSettings, hide: str | None, seed: int, mesh: tuple[str, bytes] | None
) -> str:
    document = [_csv(plan), plan.meta.to_toml(), rig.to_dict(), hide, seed]
    if mesh is not None:
        document.append(hashlib.sha256(mesh[1]).hexdigest())
    return hashlib.sha256(json.dumps(document).encode()).hexdigest()


def _ledger(path: Path, key: str, *, overwrite: bool) -> tuple[set[int], set[int]]:
    """Which tables are this job's own, and which of them are done."""
    if not path.exists():
        return set(), set()
    with suppress(OSError, ValueError, KeyError, TypeError):  # damaged, or of another kind
        stored = json.loads(path.read_text(encoding="utf-8"))
        own, done = ({int(i) for i in stored[name]} for name in ("own", "done"))
        if stored["key"] == key:
            return own, done
    if overwrite:
        return set(), set()
    raise InputError(
        f"{path}: these are campaigns of another plan, rig, seed or hidden effect, and "
        "measurements are not overwritten. Choose another name, or say --overwrite (in "
        "Python: overwrite=True)"
    )


def _on_workers(scheduler: str, work: Iterable[tuple[int, Any]], finished: Any) -> None:
    with dask_client(scheduler) as client:
        futures = {client.submit(measured_files, *args, pure=False): i for i, args in work}
        for future in dask_completed(client, futures):
            finished(futures[future], future.result())
