"""The version of a release, and whether every file that states it agrees.

python -m release.version                  the files agree
python -m release.version v0.1.0           and the tag is that of their version
python -m release.version v0.1.0 --changes  prints its section of CHANGELOG.md
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


STATED = {
    "Cargo.toml": (
        r'^(?P<what>version) = "(?P<version>.+)"$',
        r'^(?P<what>ecm-[\w-]+) = .*\bversion = "(?P<version>[^"]+)".*$',
    ),
    "Cargo.lock": (r'^name = "(?P<what>ecm-[\w-]+)"\nversion = "(?P<version>.+)"$',),
    "CITATION.cff": (r"^(?P<what>version): (?P<version>\S+)$",),
    # The newest release stands first, below "Unreleased".
    "CHANGELOG.md": (r"\A(?:.*\n)*?## (?P<version>\d\S*) \((?P<what>[\d-]{10})\)$",),
}
"""Files that state the version, and the lines that do so."""


def stated(root: Path = ROOT) -> dict[str, str]:
    """Return the version of each line that states it, by file and what the line is about."""
    versions = {}
    for file, patterns in STATED.items():
        text = (root / file).read_text(encoding="utf-8")
        for pattern in patterns:
            found = list(re.finditer(pattern, text, re.M))
            if not found:
                raise ValueError(f"{file} states no version: no line like {pattern}")
            versions.update({f"{file}, {line['what']}": line["version"] for line in found})
    return versions


def changes(version: str, root: Path = ROOT) -> str:
    """Return the section of CHANGELOG.md on this version, without its heading."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {re.escape(version)} .*\n((?:(?!## ).*\n?)*)", text, re.M)
    if section is None:
        raise ValueError(f"CHANGELOG.md has no section '## {version} (date)'; write it")
    return section[1].strip() + "\n"


def check(tag: str = "", root: Path = ROOT) -> str:
    """Return the one version of all files; with a tag, that of the tag.

    Raises
    ------
    ValueError
        Files that disagree, or a tag of another version; the message names each.
    """
    versions = stated(root)
    if len(set(versions.values())) != 1:
        raise ValueError("the files state several versions: " + json.dumps(versions, indent=2))
    (version,) = set(versions.values())
    if tag and tag != f"v{version}":
        raise ValueError(f"the tag {tag} is not v{version}, the version of the files")
    return version


def oldest_rust(root: Path = ROOT) -> str:
    """Return the oldest compiler that the crates promise."""
    (found,) = re.findall(
        r'^rust-version = "(.+)"$', (root / "Cargo.toml").read_text(encoding="utf-8"), re.M
    )
    return str(found)


def main() -> int:
    """Print the version, or the changes of the version, or what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tag", nargs="?", default="")
    parser.add_argument("--changes", action="store_true", help="print its section of CHANGELOG.md")
    options = parser.parse_args()
    try:
        version = check(options.tag)
        print(changes(version) if options.changes else version)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
