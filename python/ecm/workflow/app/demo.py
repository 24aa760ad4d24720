"""The files of `ecm app --demo`: a plan of measurements of the neck, and a simulated rig."""

from __future__ import annotations

from pathlib import Path

from ecm.errors import InputError
from ecm.io.cache import write_atomically

PLAN, RIG = "plan.csv", "rig.toml"
DEMO_FILES = (PLAN, "plan.toml", RIG)
_FILES = Path(__file__).parent / "demo"


def write_demo(folder: Path) -> None:
    """Write plan and rig into a session folder; the campaign is a step.

    Raises
    ------
    InputError
        Where the folder has other files of these names.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as name:
    ...     write_demo(Path(name))
    ...     sorted(path.name for path in Path(name).iterdir())
    ['plan.csv', 'plan.toml', 'rig.toml']
    """
    files = {folder / name: (_FILES / name).read_bytes() for name in DEMO_FILES}
    for path, content in files.items():
        if path.exists() and path.read_bytes() != content:
            raise InputError(
                f"{path} is there already, and not that of the demo: name another folder with "
                "--session"
            )
    for path, content in files.items():
        write_atomically(path, content)
