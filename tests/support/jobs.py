"""The main job as a command, and the FEM cases that it leaves for others."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from ecm.io.cache import hash_of
from support.neck import ROOT
from support.programs import ended

QUICK = ROOT / "examples" / "quick.toml"
USUAL = {"n": 240, "n_test": 40, "design": 100}
"""Counts of that file: pairs, those of them that are held out, poses of a design."""


def write_smaller(path: Path, **counts: int) -> None:
    """Write the settings of QUICK with some of its counts lowered: less of the same work."""
    text = QUICK.read_text(encoding="utf-8")
    for name, count in counts.items():
        line = "[design]\nn = {}" if name == "design" else f"\n{name} = {{}}\n"
        assert text.count(line.format(USUAL[name])) == 1, name
        text = text.replace(line.format(USUAL[name]), line.format(count))
    path.write_text(text, encoding="utf-8")


def identify_command(config: Path, out: Path, *options: str) -> list[str]:
    """`ecm identify CONFIG --out OUT OPTIONS` of this environment."""
    ecm = Path(sys.executable).parent / "ecm"
    return [str(ecm), "identify", str(config), "--out", str(out), *options]


def identify(config: Path, out: Path, *options: str) -> None:
    """Run the job to its end."""
    ended(*identify_command(config, out, *options), timeout=900)


def identify_with_kept_fem(config: Path, out: Path, *options: str) -> None:
    """Run the job; what FEM solved for it stays in the cache folder of this code for the next time.

    That is the time of the job nearly by itself. The run that is killed solves some of the
    cases and of the poses again, and must end with the same bytes.
    """
    kept = Path(os.environ["ECM_CACHE"]) / f"job-{hash_of(config.read_text(encoding='utf-8'))[:16]}"
    if kept.is_dir():
        copy_fem(kept, out)
    identify(config, out, *options)
    if not kept.is_dir():
        unfinished = kept.with_suffix(".unfinished")
        shutil.rmtree(unfinished, ignore_errors=True)
        copy_fem(out, unfinished)
        unfinished.rename(kept)


def copy_fem(job: Path, other: Path, without: int = 0) -> None:
    """Copy the FEM cases that a job has solved, and the poses of its campaigns, to another job."""
    copy_cases(job, other / "stages", without)
    shutil.copytree(job / "stages" / "anchors", other / "stages" / "anchors")


def copy_cases(job: Path, parts: Path, without: int = 0) -> None:
    """Copy FEM cases that a job has solved, all but the last chunks, for another to go on from.

    A slow machine keeps more cases in fewer chunks: where they are no more, none is copied.

    A case depends only on the body, the box, the seed and the cases before its batch: a
    simulation of fewer pairs of the same neck and seed begins with the same cases.
    """
    for solved in (job / "stages").glob("simulate-*.parts"):
        target = parts / solved.name
        target.mkdir(parents=True)
        files = sorted(solved.iterdir())
        for file in files[: max(0, len(files) - without)]:
            (target / file.name).write_bytes(file.read_bytes())
