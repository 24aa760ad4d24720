"""One plan on many rigs: each has a seed of its own, here or on the workers of a Dask scheduler.

`NAME.csv` becomes `NAME-0000.csv`, `NAME-0001.csv`, ..., each with all files of a table.
`NAME.rigs.json` holds which of them are this job's own and which are done: a table that is there
under the same settings is not measured again, one that somebody else put there is not overwritten,
and a kill loses at most the rigs that were under way.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.cache import write_atomically
from ecm.io.dask import DaskClient
from ecm.io.table import Table, read_table
from ecm.rig.elastic import Progress
from ecm.rig.journal import clear_beside, keep_data
from ecm.rig.run import CampaignOptions, run_campaign
from ecm.rig.settings import RigSettings


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
    ledger = _Ledger.of(ledger_path(out), _key(plan, rig, hide, seed), overwrite=overwrite)
    for i, path in enumerate(paths):
        # A journal that is there is a single campaign's, never this job's.
        keep_data(path, overwrite=overwrite or i in ledger.own, resume=False)
    numbers = set(range(rigs))
    if overwrite and ledger.done >= numbers:
        ledger.done -= numbers  # nothing is unfinished: all of it is to be measured again
    ledger.own |= numbers
    ledger.save()
    done = ledger.done
    open_ = [i for i, path in enumerate(paths) if i not in done or not path.exists()]
    settings = rig.to_dict()
    meta = plan.meta.to_toml()
    text = _csv(plan)

    def finished(i: int, files: dict[str, bytes]) -> None:
        for suffix, content in sorted(files.items()):
            write_atomically(
                paths[i] if suffix == ".csv" else paths[i].with_suffix(suffix), content
            )
        clear_beside(paths[i], files)
        done.add(i)
        ledger.save()
        if progress is not None:
            progress(len(done & numbers), rigs, "rigs")

    work = ((i, (text, meta, settings, hide, seed + i, threads)) for i in open_)
    if options.scheduler is None:
        for i, arguments in work:
            finished(i, measured_files(*arguments))
    else:
        _on_workers(options.scheduler, work, finished)
    return paths


def measured_files(
    plan: str, meta: str, settings: dict[str, Any], hide: str | None, seed: int, threads: int
) -> dict[str, bytes]:
    """The files of one campaign by suffix; everything comes and goes as text, to any machine."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "plan.csv"
        source.write_text(plan, encoding="utf-8")
        source.with_suffix(".toml").write_text(meta, encoding="utf-8")
        table = read_table(source, need="predict")
        out = Path(folder) / "data.csv"
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


def _key(plan: Table, rig: RigSettings, hide: str | None, seed: int) -> str:
    document = [_csv(plan), plan.meta.to_toml(), rig.to_dict(), hide, seed]
    return hashlib.sha256(json.dumps(document).encode()).hexdigest()


@dataclass
class _Ledger:
    """Which tables are this job's own, and which of them are done."""

    path: Path
    key: str
    own: set[int] = field(default_factory=set)
    done: set[int] = field(default_factory=set)

    @staticmethod
    def of(path: Path, key: str, *, overwrite: bool) -> _Ledger:
        if not path.exists():
            return _Ledger(path, key)
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            done = {int(i) for i in stored["done"]}
            own = {int(i) for i in stored["own"]}
            if stored["key"] == key:
                return _Ledger(path, key, own, done)
        except (OSError, ValueError, KeyError, TypeError):
            pass
        if overwrite:
            return _Ledger(path, key)
        raise InputError(
            f"{path}: these are campaigns of another plan, rig, seed or hidden effect, and "
            "measurements are not overwritten. Choose another name, or say --overwrite (in "
            "Python: overwrite=True)"
        )

    def save(self) -> None:
        document = {"key": self.key, "own": sorted(self.own), "done": sorted(self.done)}
        write_atomically(self.path, json.dumps(document))


def _on_workers(scheduler: str, work: Iterable[tuple[int, Any]], finished: Any) -> None:
    with DaskClient(scheduler) as client:
        futures = {client.submit(measured_files, *arguments): i for i, arguments in work}
        for future in client.completed(futures):
            finished(futures[future], future.result())
