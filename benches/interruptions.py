"""Commands that are interrupted at chosen moments of their life, run again, and compared."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

WORDS_OF_A_TRACEBACK = ("Traceback", "Exception ignored", "KeyboardInterrupt", "BrokenPipe")
_LONGEST_S = 300.0
_AFTER_S = 30.0
"""Longest life of what a killed command leaves running."""

Moment = Callable[["Life"], bool]
"""Whether a running command has come to the moment of its interruption."""


@dataclass(frozen=True)
class Life:
    """A running command."""

    process: subprocess.Popen[bytes]
    folder: Path
    output: Path
    begin_s: float

    def age_s(self) -> float:
        """Seconds since its start."""
        return time.monotonic() - self.begin_s

    def runs_ecm(self) -> bool:
        """Whether the compiled part of ecm is loaded."""
        try:
            maps = Path(f"/proc/{self.process.pid}/maps").read_bytes()
        except OSError:
            return False
        return b"/ecm/_native" in maps

    def catches(self, number: int) -> bool:
        """Whether the process has a handler of its own for a signal."""
        try:
            status = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return False
        caught = next(s for s in status.splitlines() if s.startswith("SigCgt:"))
        return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


@dataclass(frozen=True)
class End:
    """How a command ended."""

    code: int
    text: str
    """What it printed, on both streams."""
    sent: bool
    """Whether it was interrupted; else it ended before."""
    early: bool = False
    """Whether the interruption came before Python had loaded anything of ecm."""
    orphans: bool = False
    """Whether a process that it had started still ran half a minute later."""

    def faults(self, number: int) -> list[str]:
        """What is wrong with the end of a command after a signal."""
        found = [word for word in WORDS_OF_A_TRACEBACK if word in self.text]
        if self.orphans:
            found.append("a process was left running")
        if number == signal.SIGKILL or not self.sent:
            return found
        if self.code != 130:
            found.append(f"exit code {self.code}")
        if sum(line.startswith("Interrupted; ") for line in self.text.splitlines()) != 1:
            found.append("not one line 'Interrupted; '")
        return found


def loads_ecm(life: Life) -> bool:
    """The process has come so far that it loads modules of ecm, or answers signals by it."""
    return life.catches(signal.SIGTERM) or life.runs_ecm()


def after(seconds: float) -> Moment:
    """So many seconds after the start of the process."""
    return lambda life: life.age_s() >= seconds


def when(begins: Moment, seconds: float = 0.0) -> Moment:
    """So many seconds after another moment."""
    first: list[float] = []

    def come(life: Life) -> bool:
        if not first and begins(life):
            first.append(time.monotonic())
        return bool(first) and time.monotonic() - first[0] >= seconds

    return come


def written(name: str) -> Moment:
    """A file of the command has appeared."""
    return lambda life: (life.folder / name).exists()


def printed(text: str) -> Moment:
    """The command has printed a text."""
    return lambda life: text.encode() in life.output.read_bytes()


def run(
    arguments: Sequence[str],
    folder: Path,
    *,
    moment: Moment | None = None,
    number: int = signal.SIGINT,
    environment: Mapping[str, str] | None = None,
) -> End:
    """Run `ecm ARGUMENTS` in a folder, and send it a signal when its moment has come."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # As a shell's background job has it; the command would inherit that and ignore Ctrl-C.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.NamedTemporaryFile() as sink:
        process = subprocess.Popen(
            [sys.executable, "-m", "ecm", *arguments],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink,
            env={**os.environ, **(environment or {})}, start_new_session=True,
        )  # fmt: skip
        life = Life(process, folder, Path(sink.name), time.monotonic())
        sent = early = False
        while process.poll() is None and life.age_s() < _LONGEST_S:
            if moment is not None and not sent and moment(life):
                early = not loads_ecm(life)
                sent = process.poll() is None
            if sent:
                # As a terminal does: to the whole group, which is there until it is waited for.
                os.killpg(process.pid, number)
                process.wait(_LONGEST_S)
            time.sleep(0.0005)
        end = time.monotonic() + _AFTER_S
        while (orphans := _has_open(sink.name)) and time.monotonic() < end:
            time.sleep(0.02)
        text = Path(sink.name).read_text(errors="replace")
        return End(process.wait(), text, sent, early, orphans)


def _has_open(name: str) -> bool:
    """Whether another process has a file open: whoever was started with it as its stderr."""
    own = os.getpid()
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) == own:
            continue
        try:
            if any(os.readlink(handle) == name for handle in (process / "fd").iterdir()):
                return True
        except OSError:
            continue
    return False


def files(folder: Path) -> dict[str, bytes]:
    """All files of a folder by name; those under other names for the time of writing left out."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.endswith(".tmp")
    }
