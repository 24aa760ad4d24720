"""What can be tried of a release on one Linux machine, as one command: `make release-check`.

Each line is a check: "ok", "failed", or "not run" with what is missing. What needs
another machine (macOS, Windows on Windows, publishing) is in .github/workflows/release.yml.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from release import foreign, size, trial, version, wheels
from release.foreign import NotHereError

ROOT = Path(__file__).parents[2]


class Release:
    """The checks, in the order of their needs; each returns a line of words."""

    def __init__(self, work: Path) -> None:
        """Everything is made below the folder `work`."""
        self.work = work.resolve()
        self.dist = self.work / "dist"
        self.figures = self.work / "figures.txt"

    def versions(self) -> str:
        """Every file states one version."""
        return version.check()

    def crates(self) -> str:
        """The archives of the crates build, in the order in which they are published."""
        command = ["cargo", "publish", "--workspace", "--locked", "--dry-run", "--allow-dirty"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        # The only warning is that nothing is uploaded.
        warnings = re.findall(r"^warning: (?!aborting upload).*$", done.stderr, re.M)
        if done.returncode != 0 or warnings:
            raise RuntimeError(done.stderr)
        return " → ".join(re.findall(r"Uploading ([\w-]+) v", done.stderr))

    def oldest(self) -> str:
        """The oldest compiler that Cargo.toml promises accepts every crate."""
        foreign.need("rustup", advice="the oldest compiler comes by rustup")
        subprocess.run(
            ["make", "oldest-rust"], cwd=ROOT, capture_output=True, text=True, check=True
        )
        return f"rustc {version.oldest_rust()}"

    def linux(self) -> str:
        """The manylinux wheel, installed without a compiler."""
        wheel = self._wheel("x86_64-unknown-linux-gnu")
        self.figures.write_text(trial.try_archive(wheel), encoding="utf-8")
        return f"{wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB"

    def installed(self) -> str:
        """How much a plain install downloads and takes, and how fast `ecm --help` answers."""
        return size.words(self._wheel("x86_64-unknown-linux-gnu"))

    def musl(self) -> str:
        """The musllinux wheels keep their tag; that of this processor gives the same figures."""
        own, other = (self._wheel(f"{name}-unknown-linux-musl") for name in ("x86_64", "aarch64"))
        used = self._same(foreign.use_on_musl(own, self.work))
        return f"{own.name}, {used}; {other.name}"

    def aarch64(self) -> str:
        """The manylinux wheel of aarch64 under qemu gives the figures of this machine."""
        wheel = self._wheel("aarch64-unknown-linux-gnu")
        return self._same(foreign.use_on_aarch64(wheel, self.work))

    def windows(self) -> str:
        """The wheel of Windows under wine gives the figures of this machine."""
        foreign.need(foreign.MINGW, advice="apt-get install gcc-mingw-w64-x86-64")
        wheel = self._wheel("x86_64-pc-windows-gnu")
        return self._same(foreign.use_on_windows(wheel, self.work))

    def source(self) -> str:
        """The source archive is built and used by pip alone."""
        command = ["maturin", "sdist", "--out", str(self.dist)]
        subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
        (archive,) = self.dist.glob("*.tar.gz")
        return f"{archive.name}, {self._same(trial.try_archive(archive))}"

    def _wheel(self, target: str) -> Path:
        tag = wheels.TARGETS[target].tag
        there = list(self.dist.glob(f"*-{tag}.whl"))
        return there[0] if there else wheels.build(target, self.dist)

    def _same(self, printed: str) -> str:
        if not self.figures.exists():
            return "ran; the check 'linux' writes the figures to compare with"
        expected = self.figures.read_text(encoding="utf-8")
        if printed.split() != expected.split():
            raise RuntimeError(f"expected\n{expected}\nfound\n{printed}")
        return "the same figures"


CHECKS: tuple[Callable[[Release], str], ...] = (
    Release.versions,
    Release.crates,
    Release.oldest,
    Release.linux,
    Release.installed,
    Release.musl,
    Release.aarch64,
    Release.windows,
    Release.source,
)


def main() -> int:
    """Run the checks that are named, or all."""
    names = [check.__name__ for check in CHECKS]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("checks", nargs="*", metavar="CHECK", help=f"of {', '.join(names)}")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "release")
    options = parser.parse_args()
    unknown = sorted(set(options.checks) - set(names))
    if unknown:
        parser.error(f"no check {unknown[0]}; there are {', '.join(names)}")
    release = Release(options.work)
    failed = 0
    for check in CHECKS:
        if options.checks and check.__name__ not in options.checks:
            continue
        began = time.monotonic()
        try:
            outcome, words = "ok", check(release)
        except NotHereError as error:
            outcome, words = "not run", str(error)
        except subprocess.CalledProcessError as error:
            outcome, words = "failed", f"{error}\n{error.stdout or ''}{error.stderr or ''}"
            failed += 1
        except (RuntimeError, ValueError) as error:
            outcome, words = "failed", str(error)
            failed += 1
        print(
            f"{check.__name__:10} {outcome:8} {time.monotonic() - began:6.0f} s  {words}",
            flush=True,
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
