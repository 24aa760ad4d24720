"""Prints the requirements of the package and of the extras named as arguments.

`make setup` installs them before the package itself is built, so that a change of the code
does not resolve the dependencies anew.
"""

from __future__ import annotations

import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:  # pip carries a reader that every virtual environment has
    from pip._vendor import tomli as tomllib


def requirements(extras: list[str]) -> list[str]:
    """The plain dependencies and those of the given extras, without environment markers' spaces."""
    text = (Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    found = list(project["dependencies"])
    for extra in extras:
        found += project["optional-dependencies"][extra]
    return [requirement.replace(" ", "") for requirement in found]


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1:])))
