"""All targets of `ecm export`; their one-line descriptions are `ecm.cli.options.export`."""

from __future__ import annotations

from ecm.models.export import code, fmu, mujoco, opensim, python_targets, simulink
from ecm.models.export.source import Target

TARGETS: dict[str, Target] = {
    "c": Target(code.c, precisions=("double", "single")),
    "rust": Target(code.rust, language="rust", precisions=("double", "single")),
    "mujoco": Target(mujoco.mujoco, taken=("mj",)),
    "fmu": Target(fmu.fmu, taken=("instance", "fmi2", "fmi3")),
    "opensim": Target(opensim.opensim, language="none"),
    "simulink": Target(simulink.simulink, taken=("mex", "simstruc", "simulink")),
    "drake": Target(python_targets.drake),
    "pinocchio": Target(python_targets.pinocchio),
    "ros2": Target(python_targets.ros2),
}
"""Every target; a new one is one more line here and one in the options of the command."""
