"""Stiffness maps of elastic continuum mechanisms.

From a mesh and a handful of measurements to a wrench h(p) and a stiffness K(p) that run in a
1 kHz controller, and to the name of the physical effect that the model still lacks.

Each command of the command line is a function of the same name: `simulate`, `fit`, `predict`,
`design`, `campaign`, `check`, `compare`, `diagnose`, `refit`, `reveal`, `export`, `identify`;
`ecm import` is `import_log`, `ecm app` is `serve`.

Poses are (x, y, z, theta_x, theta_y, theta_z) in m and rad, wrenches (fx, fy, fz, taux, tauy,
tauz) in N and N m, both in base axes at the top frame's origin.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # the module typing takes long to load
if TYPE_CHECKING:
    from typing import Any

    from ecm._native import __version__
    from ecm.bench.run import measure
    from ecm.bench.settings import Bench
    from ecm.comparison.comparison import compare
    from ecm.comparison.result import Comparison
    from ecm.comparison.sines import dynamic_stiffness
    from ecm.designs.optimal import Design, optimal_design
    from ecm.designs.plans import diagnosable_plan, paper_plan
    from ecm.designs.regressors import DesignSettings
    from ecm.diagnosis.procedure import diagnose
    from ecm.diagnosis.result import Diagnosis
    from ecm.diagnosis.settings import DiagnosisSettings
    from ecm.errors import ComputationError, EcmError, InputError, MissingExtra
    from ecm.fem.simulate import Simulated, Workspace, fem_poses, simulate, solve_wrenches
    from ecm.io.mechanism import Mechanism
    from ecm.io.table import Table, as_table, read_table
    from ecm.logs.importing import ImportedLog, import_log
    from ecm.models.check import check
    from ecm.models.control_loop import LoopSettings
    from ecm.models.energy import EnergyModel
    from ecm.models.estimator import ModelEstimator
    from ecm.models.export import export
    from ecm.models.expression import Expression
    from ecm.models.fit import fit_model
    from ecm.models.fit import fit_model as fit
    from ecm.models.learned import GaussianProcessModel, NeuralNetworkModel
    from ecm.models.model import Model, load_model
    from ecm.models.parameters import Parameter
    from ecm.models.physics.refit import PhysicsModel
    from ecm.models.polynomial import PolynomialModel
    from ecm.models.prediction import predict
    from ecm.models.refit import refit
    from ecm.models.rod import ConstantCurvatureModel, RodModel
    from ecm.models.selection import cross_validate
    from ecm.rig.hidden.truth import reveal
    from ecm.rig.run import run_campaign
    from ecm.rig.run import run_campaign as campaign
    from ecm.rig.settings import RigSettings
    from ecm.workflow.app.server import serve
    from ecm.workflow.design import PlannedDesign, design
    from ecm.workflow.identify import identify

_NAMES = {
    "_native": ("__version__",),
    "bench.run": ("measure",),
    "bench.settings": ("Bench",),
    "comparison.comparison": ("compare",),
    "comparison.result": ("Comparison",),
    "comparison.sines": ("dynamic_stiffness",),
    "designs.optimal": ("Design", "optimal_design"),
    "designs.plans": ("diagnosable_plan", "paper_plan"),
    "designs.regressors": ("DesignSettings",),
    "models.check": ("check",),
    "diagnosis.procedure": ("diagnose",),
    "diagnosis.result": ("Diagnosis",),
    "diagnosis.settings": ("DiagnosisSettings",),
    "errors": ("ComputationError", "EcmError", "InputError", "MissingExtra"),
    "fem.simulate": ("Simulated", "Workspace", "fem_poses", "simulate", "solve_wrenches"),
    "io.mechanism": ("Mechanism",),
    "io.table": ("Table", "as_table", "read_table"),
    "logs.importing": ("ImportedLog", "import_log"),
    "models.energy": ("EnergyModel",),
    "models.estimator": ("ModelEstimator",),
    "models.control_loop": ("LoopSettings",),
    "models.export": ("export",),
    "models.expression": ("Expression",),
    "models.fit": ("fit", "fit_model"),
    "models.learned": ("GaussianProcessModel", "NeuralNetworkModel"),
    "models.model": ("Model", "load_model"),
    "models.parameters": ("Parameter",),
    "models.physics.refit": ("PhysicsModel",),
    "models.polynomial": ("PolynomialModel",),
    "models.prediction": ("predict",),
    "models.refit": ("refit",),
    "models.rod": ("ConstantCurvatureModel", "RodModel"),
    "models.selection": ("cross_validate",),
    "rig.hidden.truth": ("reveal",),
    "rig.run": ("campaign", "run_campaign"),
    "rig.settings": ("RigSettings",),
    "workflow.app.server": ("serve",),
    "workflow.design": ("PlannedDesign", "design"),
    "workflow.identify": ("identify",),
}
"""The public names by their module: a module is imported when a name of it is first used."""

_ALIASES = {"campaign": "run_campaign", "fit": "fit_model"}
"""The verbs of the command line that are functions of another name."""

_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Bench",
    "Comparison",
    "ComputationError",
    "ConstantCurvatureModel",
    "Design",
    "DesignSettings",
    "Diagnosis",
    "DiagnosisSettings",
    "EcmError",
    "EnergyModel",
    "Expression",
    "GaussianProcessModel",
    "ImportedLog",
    "InputError",
    "LoopSettings",
    "Mechanism",
    "MissingExtra",
    "Model",
    "ModelEstimator",
    "NeuralNetworkModel",
    "Parameter",
    "PhysicsModel",
    "PlannedDesign",
    "PolynomialModel",
    "RigSettings",
    "RodModel",
    "Simulated",
    "Table",
    "Workspace",
    "__version__",
    "as_table",
    "campaign",
    "check",
    "compare",
    "cross_validate",
    "design",
    "diagnosable_plan",
    "diagnose",
    "dynamic_stiffness",
    "export",
    "fem_poses",
    "fit",
    "fit_model",
    "identify",
    "import_log",
    "load_model",
    "measure",
    "optimal_design",
    "paper_plan",
    "predict",
    "read_table",
    "refit",
    "reveal",
    "run_campaign",
    "serve",
    "simulate",
    "solve_wrenches",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'ecm' has no attribute '{name}'")
    value = getattr(import_module(f"ecm.{_MODULE_OF[name]}"), _ALIASES.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
