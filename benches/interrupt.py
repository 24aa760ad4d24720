"""Interrupts every long command at many moments of its life, runs it again, compares the bytes.

    python benches/interrupt.py                          # all commands, ten rounds each
    python benches/interrupt.py fit arm --rounds 50 --signal KILL

A round begins in a new folder with a cache of its own. There the command is interrupted four
times: in the first 200 ms of ecm, anywhere, in the 50 ms after its first result is written, and in
the last 100 ms. Then it is run to its end, and all files must be those of an uninterrupted run.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from interruptions import End, Moment, after, files, loads_ecm, run, when, written

CONFIG = """
[mechanism]
builtin = "cylinder"
length_m = 0.1034
radius_m = 0.033
young_modulus_Pa = 0.65e6
poisson_ratio = 0.49
[simulate]
n = 60
n_test = 20
[select]
degrees = [1, 2]
thresholds = [0.0]
energy_degrees = [4]
energy_poses = [20]
[design]
n = 30
starts = 2
"""
RIG = '[rig]\nmode = "quasi_static"\n'
ARM = '[rig]\nmode = "robot"\nprocesses = 2\nspeed_rad_s = 0.6\nspeed_m_s = 0.08\ndwell_s = 0.1\n'
PREPARATION = (
    "simulate config.toml --out pairs.csv",
    "design pairs.csv --n 8 --model linear --starts 1 --out plan.csv",
    "fit pairs.csv --model energy4 --out model.json",
    "campaign plan.csv --rig rig.toml --out measured.csv",
)
COMMANDS = {
    "simulate": "simulate config.toml --out s.csv --json s.json",
    "design": "design pairs.csv --n 12 --model linear --starts 2 --out d.csv --json d.json",
    "campaign": "campaign plan.csv --rig rig.toml --hide payload=2 --out c.csv --json c.json",
    "arm": "campaign plan.csv --rig arm.toml --out a.csv",
    "fit": "fit pairs.csv --model energy4 --out f.json --json f2.json",
    "diagnose": "diagnose model.json measured.csv --json g.json --report g.html --next next.csv",
    "export": "export model.json --to c --out code",
    "identify": "identify config.toml --out job",
}
FIRST_S, LAST_S, FILE_S = 0.2, 0.1, 0.05
WHERE = ("first", "all", "file", "last")


@dataclass
class Tally:
    """What became of the interruptions of one command."""

    sent: int = 0
    early: int = 0
    """Before Python had loaded anything of ecm, where nothing of ecm can answer."""
    ended: int = 0
    """The command was done before its moment came, or in the instant of the signal."""
    right: int = 0
    wrong: int = 0
    other_bytes: int = 0

    def __str__(self) -> str:
        return (
            f"{self.sent} sent, {self.early} before ecm was loaded, {self.ended} ended before, "
            f"{self.right} as they should, {self.wrong} wrong, {self.other_bytes} with other bytes"
        )


def prepare(folder: Path) -> None:
    """Write the inputs of all commands."""
    for name, text in (("config.toml", CONFIG), ("rig.toml", RIG), ("arm.toml", ARM)):
        (folder / name).write_text(text)
    for line in PREPARATION:
        done = run(line.split(), folder, environment={"ECM_CACHE": str(folder / "cache")})
        if done.code != 0:
            sys.exit(f"ecm {line}\n{done.text}")
    shutil.rmtree(folder / "cache", ignore_errors=True)


def results(folder: Path) -> dict[str, bytes]:
    """The files of a folder without its cache and without what depends on the clock.

    These are times, a job's report, which draws them, and the parts of a simulation, which are cut
    where some seconds have passed; the table that they make up is compared.
    """
    found = {name: text for name, text in files(folder).items() if not name.startswith("cache/")}
    timed = ("times", "job/report.html", ".parts/")
    return {name: text for name, text in found.items() if not any(t in name for t in timed)}


class Trial:
    """One command, interrupted again and again."""

    def __init__(self, name: str, inputs: Path, work: Path, number: signal.Signals) -> None:
        self._arguments = COMMANDS[name].split()
        self._inputs, self._work, self._number = inputs, work, number
        out = "--out" if "--out" in self._arguments else "--json"
        self._first_file = self._arguments[self._arguments.index(out) + 1]
        self.name = name
        self.tally = Tally()
        self._life_s = 0.0
        folder = self._folder()
        self._finish(folder)
        self._whole = results(folder)

    def round(self, random: np.random.Generator) -> None:
        """Interrupt at four moments, run to the end, and compare."""
        folder = self._folder()
        for where in WHERE:
            end = self._run(folder, self._moment(where, random.uniform()))
            self._count(end, where)
            if end.code in (0, 2):  # it is complete, and would be done again or refused
                self._compare(folder)
                folder = self._folder()
        self._compare(folder)

    def _moment(self, where: str, share: float) -> Moment:
        return {
            "first": when(loads_ecm, share * FIRST_S),
            "all": when(loads_ecm, share * self._life_s),
            "file": when(written(self._first_file), share * FILE_S),
            "last": after(self._life_s - share * LAST_S),
        }[where]

    def _count(self, end: End, where: str) -> None:
        self.tally.sent += end.sent
        if end.early:
            self.tally.early += 1
        elif not end.sent or end.code in (0, 2):
            self.tally.ended += 1
        elif faults := end.faults(self._number):
            self.tally.wrong += 1
            print(f"{self.name} ({where}): {', '.join(faults)}\n{end.text}", flush=True)
        else:
            self.tally.right += 1

    def _compare(self, folder: Path) -> None:
        """Run to the end; the files must be those of a run that nobody interrupted."""
        self._finish(folder)
        found = results(folder)
        if found != self._whole:
            self.tally.other_bytes += 1
            names = {name for name, _ in found.items() ^ self._whole.items()}
            print(f"{self.name}: other bytes in {', '.join(sorted(names))}", flush=True)
        shutil.rmtree(folder)

    def _finish(self, folder: Path) -> None:
        begin = time.monotonic()
        done = self._run(folder)
        if done.code == 2 and "--overwrite" in done.text:
            done = self._run(folder, more=["--overwrite"])
        elif done.code == 0:
            self._life_s = time.monotonic() - begin
        if done.code != 0:
            print(f"{self.name}: does not go on\n{done.text}", flush=True)

    def _folder(self) -> Path:
        folder = Path(tempfile.mkdtemp(dir=self._work))
        shutil.copytree(self._inputs, folder, dirs_exist_ok=True)
        return folder

    def _run(self, folder: Path, moment: Moment | None = None, more: Sequence[str] = ()) -> End:
        arguments = [*self._arguments, *more]
        cache = {"ECM_CACHE": str(folder / "cache")}
        return run(arguments, folder, moment=moment, number=self._number, environment=cache)


def main() -> None:
    """Print a line per command, and what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commands", nargs="*", help=f"of {', '.join(COMMANDS)}; default: all")
    parser.add_argument("--rounds", type=int, default=10, help="of four interruptions each")
    parser.add_argument("--signal", choices=("INT", "TERM", "KILL"), default="INT")
    options = parser.parse_args()
    random = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as top:
        inputs, work = Path(top) / "inputs", Path(top) / "work"
        inputs.mkdir()
        work.mkdir()
        prepare(inputs)
        for name in options.commands or COMMANDS:
            trial = Trial(name, inputs, work, signal.Signals[f"SIG{options.signal}"])
            for _ in range(options.rounds):
                trial.round(random)
                print(f"{name:9s} {trial.tally}", flush=True)


if __name__ == "__main__":
    main()
