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
    "models.control_loop": ("LoopSettings",),
    "models.export": ("export",),
    "models.expression": ("Expression",),
    "models.estimator": ("ModelEstimator", "fit", "fit_model"),
    "models.literature": (
        "ConstantCurvatureModel",
        "GaussianProcessModel",
        "NeuralNetworkModel",
        "RodModel",
    ),
    "models.model": ("Model", "load_model"),
    "models.parameters": ("Parameter",),
    "models.physics.refit": ("PhysicsModel",),
    "models.polynomial": ("PolynomialModel",),
    "models.prediction": ("predict",),
    "models.refit": ("refit",),
    "models.selection": ("cross_validate",),
    "rig.truth": ("reveal",),
    "rig.run": ("campaign", "run_campaign"),
    "rig.settings": ("RigSettings",),
    "workflow.app.server": ("serve",),
    "workflow.design": ("PlannedDesign", "design"),
    "workflow.identify": ("identify",),
}
"""The public names by their module: a module is imported when a name of it is first used.

For type checkers they stand in `__init__.pyi`.
"""

_ALIASES = {"campaign": "run_campaign", "fit": "fit_model"}
"""The verbs of the command line that are functions of another name."""

_MODULE_OF = dict(sorted((name, home) for home, names in _NAMES.items() for name in names))

__all__ = list(_MODULE_OF)


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'ecm' has no attribute '{name}'")
    value = getattr(import_module(f"ecm.{_MODULE_OF[name]}"), _ALIASES.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
