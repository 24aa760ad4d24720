"""Stiffness maps of elastic continuum mechanisms.

From a mesh and a handful of measurements to a wrench h(p) and a stiffness K(p) that run in a
1 kHz controller, and to the name of the physical effect that the model still lacks.

Poses are (x, y, z, theta_x, theta_y, theta_z) in m and rad, wrenches (fx, fy, fz, taux, tauy,
tauz) in N and N m, both in base axes at the top frame's origin.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecm._native import __version__
    from ecm.compare import Comparison, compare
    from ecm.design import Design, diagnosable_plan, paper_plan
    from ecm.design.choose import choose
    from ecm.diagnose import Diagnosis, diagnose
    from ecm.errors import ComputationError, EcmError, InputError, MissingExtra
    from ecm.identify import identify
    from ecm.mechanism import Mechanism
    from ecm.models import Model, fit_model, load_model
    from ecm.rig import RigSettings, reveal, run_campaign
    from ecm.simulate import Simulated, Workspace, fem_poses, simulate
    from ecm.table import Table, as_table, read_table

_HOME = {
    "_native": ("__version__",),
    "compare": ("Comparison", "compare"),
    "design": ("Design", "choose", "diagnosable_plan", "paper_plan"),
    "diagnose": ("Diagnosis", "diagnose"),
    "errors": ("ComputationError", "EcmError", "InputError", "MissingExtra"),
    "identify": ("identify",),
    "mechanism": ("Mechanism",),
    "models": ("Model", "fit_model", "load_model"),
    "rig": ("RigSettings", "reveal", "run_campaign"),
    "simulate": ("Simulated", "Workspace", "fem_poses", "simulate"),
    "table": ("Table", "as_table", "read_table"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Comparison",
    "ComputationError",
    "Design",
    "Diagnosis",
    "EcmError",
    "InputError",
    "Mechanism",
    "MissingExtra",
    "Model",
    "RigSettings",
    "Simulated",
    "Table",
    "Workspace",
    "__version__",
    "as_table",
    "choose",
    "compare",
    "diagnosable_plan",
    "diagnose",
    "fem_poses",
    "fit_model",
    "identify",
    "load_model",
    "paper_plan",
    "read_table",
    "reveal",
    "run_campaign",
    "simulate",
]


class _Package(ModuleType):
    """Names come with their module when they are first asked for: half a second less per command.

    `compare`, `diagnose`, `identify` and `simulate` are functions here, though modules of the same
    name are below: loading one of these must not put it in the function's place.
    """

    def __getattr__(self, name: str) -> Any:
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'ecm' has no attribute '{name}'")
        value = getattr(import_module(f"ecm.{_MODULE_OF[name]}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # The import system puts a module that it has loaded into its package.
        if name in _MODULE_OF and value is sys.modules.get(f"ecm.{name}"):
            return
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *__all__})


sys.modules[__name__].__class__ = _Package
