"""Writes the FEM family of the neck and the difference of its two meshes.

The package brings them, so that the first fit takes seconds.

python scripts/neck_family.py     # minutes; after a change of the FEM, its meshes or `physics_map`
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from ecm.io.mechanism import Mechanism
from ecm.models.physics import map as physics


def main() -> None:
    """Build it without any cache, and put it in the place of the old one."""
    brought = physics.BROUGHT
    with tempfile.TemporaryDirectory() as name:
        physics.BROUGHT = Path(name)  # else it would be read, not built
        physics.physics_map(Mechanism(), cache=Path(name), progress=print)
        shutil.rmtree(brought, ignore_errors=True)
        brought.mkdir()
        for path in Path(name).glob("*.json"):
            shutil.copy(path, brought)
            print(path.name)


if __name__ == "__main__":
    main()
