"""The files of `ecm app --demo`: a plan of measurements of the neck, and a simulated rig."""

from __future__ import annotations

from pathlib import Path

from ecm.io.cache import write_atomically
from ecm.workflow.app.steps import PLAN, RIG

_FILES = Path(__file__).parent / "demo"


def write_demo(folder: Path) -> None:
    """Write plan and rig into a session folder; the campaign is its first step.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as name:
    ...     write_demo(Path(name))
    ...     sorted(path.name for path in Path(name).iterdir())
    ['plan.csv', 'plan.toml', 'rig.toml']
    """
    for name in (PLAN, "plan.toml", RIG):
        write_atomically(folder / name, (_FILES / name).read_bytes())
