"""Debian 13's packages in a folder, by apt with lists of its own: nothing is installed."""

from __future__ import annotations

import subprocess
from pathlib import Path

KEY = "/usr/share/keyrings/debian-archive-keyring.gpg"
SOURCES = "".join(
    f"{kind} [signed-by={KEY}] http://deb.debian.org/debian trixie main\n"
    for kind in ("deb", "deb-src")
)


def apt(folder: Path) -> list[str]:
    """Return the words before a command of apt that keeps everything below a folder."""
    for part in ("lists/partial", "archives/partial"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    (folder / "sources.list").write_text(SOURCES, encoding="utf-8")
    own = {
        "Dir::Etc::sourcelist": folder / "sources.list", "Dir::Etc::sourceparts": "-",
        "Dir::State::Lists": folder / "lists", "Dir::State::status": folder / "status",
        "Dir::Cache::archives": folder / "archives", "Dir::Cache::pkgcache": "",
        "Dir::Cache::srcpkgcache": "", "APT::Architecture": "amd64",
    }  # fmt: skip
    words = ["apt-get", "-qq", *(word for name in own for word in ("-o", f"{name}={own[name]}"))]
    subprocess.run([*words, "update"], check=True, capture_output=True, text=True)
    return words


def extract(packages: Path, root: Path) -> None:
    """Unpack every package of a folder into another."""
    for package in sorted(packages.glob("*.deb")):
        subprocess.run(["dpkg-deb", "--extract", package, root], check=True, capture_output=True)
