"""Drake: the system's wrench, and the acceleration of a free body that it pushes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pydrake.all as drake

from ecm.io.arrays import F
from export_tools.errors import said
from support.exports import HEAD, fitted, thousand_poses, written
from support.models import with_time


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    written(fitted("energy6"), folder, "drake")
    slow = with_time(fitted("energy4"))
    written(slow, folder, "drake", name="slow")
    sys.path.insert(0, str(folder))
    diagram, plant, body, system = scene("neck_drake")
    context = diagram.CreateDefaultContext()
    at = plant.GetMyMutableContextFromRoot(context)
    wrenches, accelerations = [], []
    for pose in thousand_poses():
        plant.SetFreeBodyPose(at, body, placed(pose))
        wrenches.append(system.GetOutputPort("wrench").Eval(system.GetMyContextFromRoot(context)))
        found = plant.EvalBodySpatialAccelerationInWorld(at, body)
        mass, inertia = HEAD.mass_kg, HEAD.inertia_kg_m2
        accelerations.append([*(-mass * found.translational()), *(-inertia * found.rotational())])
    yield f"{drake_version()}: {said(np.array(wrenches))}"
    yield f"acceleration of a free body: {said(np.array(accelerations))}"

    diagram, plant, body, system = scene("slow_drake")
    simulator = drake.Simulator(diagram)
    context = simulator.get_mutable_context()
    at = plant.GetMyMutableContextFromRoot(context)
    rest = slow.rest_pose("a bench")[0]
    controller = slow.controller()
    controller.init(rest)
    plant.SetFreeBodyPose(at, body, placed(rest + 0.003 * np.eye(6)[1]))
    plant.SetFreeBodySpatialVelocity(at, body, drake.SpatialVelocity(np.zeros(3), np.zeros(3)))
    for n in range(20):
        pose = system.pose(system.GetMyContextFromRoot(context))
        h, _ = controller.step(pose, 1e-3)
        simulator.AdvanceTo(1e-3 * (n + 0.5))
        held = system.GetOutputPort("wrench").Eval(system.GetMyContextFromRoot(context))
        np.testing.assert_allclose(held, h, rtol=1e-6, atol=1e-6)
        simulator.AdvanceTo(1e-3 * (n + 1) - 1e-12)
    yield "20 updates of the state are those of Model.controller()"


def drake_version() -> str:
    from importlib.metadata import version  # noqa: PLC0415 - pydrake has no version of its own

    return version("drake")


def placed(pose: F) -> Any:
    """A pose as Drake's transform."""
    angle = float(np.linalg.norm(pose[3:]))
    axis = pose[3:] / angle if angle else np.array([1.0, 0.0, 0.0])
    return drake.RigidTransform(drake.RotationMatrix(drake.AngleAxis(angle, axis)), pose[:3])


def scene(module: str) -> tuple[Any, Any, Any, Any]:
    """A free body on the mechanism, without gravity."""
    builder = drake.DiagramBuilder()
    plant = builder.AddSystem(drake.MultibodyPlant(0.0))
    mass, each = HEAD.mass_kg or 0.0, (HEAD.inertia_kg_m2 or 0.0) / (HEAD.mass_kg or 1.0)
    inertia = drake.SpatialInertia(mass, np.zeros(3), drake.UnitInertia(each, each, each))
    body = plant.AddRigidBody("head", inertia)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    plant.Finalize()
    system = builder.AddSystem(
        import_module(module).Mechanism(plant.world_frame(), body.body_frame())
    )
    poses, forces = system.GetInputPort("body_poses"), system.GetOutputPort("spatial_forces")
    builder.Connect(plant.get_body_poses_output_port(), poses)
    builder.Connect(forces, plant.get_applied_spatial_force_input_port())
    return builder.Build(), plant, body, system
