"""The neck as MuJoCo's passive plugin, the one that `ecm export --to mujoco` writes."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ecm._native import EnergyModel
from ecm.errors import ComputationError
from ecm.io.extras import require
from ecm.models import Model
from ecm.models.export import export_files
from ecm.models.maps import EnergyMap

_loaded: set[str] = set()


@dataclass(frozen=True)
class NeckPlugin:
    """A built plugin: the name of its model, and its library.

    Examples
    --------
    >>> NeckPlugin("neck_1", Path("libneck_1_plugin.so")).plugin
    'ecm.neck_1'
    """

    name: str
    library: Path

    @property
    def plugin(self) -> str:
        """Name under which MuJoCo knows it."""
        return f"ecm.{self.name}"

    def load(self, mujoco: Any) -> None:
        """Load the library into this process, once."""
        if self.name not in _loaded:
            mujoco.mj_loadPluginLibrary(str(self.library))
            _loaded.add(self.name)


def build_plugin(energy: EnergyModel, folder: Path) -> NeckPlugin:
    """Export an energy to MuJoCo and build its plugin with the script that is exported beside it.

    Parameters
    ----------
    energy
        Of the true neck.
    folder
        Where libraries are kept, by the hash of their source and the version of MuJoCo.

    Raises
    ------
    ComputationError
        No C++ compiler, or one that fails.
    """
    model = Model(EnergyMap(energy))
    sources = export_files(model, "mujoco", "neck").files
    # A library is made for one version of MuJoCo.
    version = require("mujoco", "robot", "The head").__version__
    text = "".join([version, *(str(sources[key]) for key in sorted(sources))])
    digest = hashlib.sha256(text.encode())
    name = f"neck_{digest.hexdigest()[:16]}"
    found = NeckPlugin(name, folder.resolve() / f"lib{name}_plugin.so")
    if found.library.exists():
        return found
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as build:
        for path, content in export_files(model, "mujoco", name).files.items():
            (Path(build) / path).write_text(str(content), encoding="utf-8")
        script = Path(build) / f"{name}_build.sh"
        done = subprocess.run(
            ["sh", str(script), sys.executable], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise ComputationError(
                "the head's neck is a C++ plugin of MuJoCo, which could not be built: "
                f"{done.stderr[:300]}; install a C and a C++ compiler (cc, c++)"
            )
        (Path(build) / found.library.name).replace(found.library)
    return found
