"""Stiffness maps of elastic continuum mechanisms.

From a mesh and a handful of measurements to a wrench h(p) and a stiffness K(p) that run in a
1 kHz controller, and to the name of the physical effect that the model still lacks.

Poses are (x, y, z, theta_x, theta_y, theta_z) in m and rad, wrenches (fx, fy, fz, taux, tauy,
tauz) in N and N m, both in base axes at the top frame's origin.
"""

from ecm._native import __version__
from ecm.compare import Comparison, compare
from ecm.design import Design, choose, diagnosable_plan, paper_plan
from ecm.diagnose import Diagnosis, diagnose
from ecm.errors import ComputationError, EcmError, InputError, MissingExtra
from ecm.identify import identify
from ecm.mechanism import Mechanism
from ecm.models import Model, fit_model, load_model
from ecm.rig import RigSettings, reveal, run_campaign
from ecm.simulate import Simulated, Workspace, fem_poses, simulate
from ecm.table import Table, as_table, read_table

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
