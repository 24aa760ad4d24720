"""Programs in Python: Drake, Pinocchio and ROS 2, each beside the model's C and its loader."""

from __future__ import annotations

from ecm.models.export.source import Files, Source


def drake(source: Source) -> Files:
    """A LeafSystem that pushes on the bodies of a MultibodyPlant."""
    rest = source.inside.rest_pose("a Drake export")[0] if source.whole else ()
    values = {"REST": ", ".join(f"{x:.17g}" for x in rest)}
    return _beside(source, "drake", "system.py.txt", f"{source.name}_drake.py", values)


def pinocchio(source: Source) -> Files:
    """External forces of the joints between two frames."""
    return _beside(source, "pinocchio", "forces.py.txt", f"{source.name}_pinocchio.py")


def ros2(source: Source) -> Files:
    """A node from stamped poses to stamped wrenches."""
    step = f"python @OUT@/{source.name}_node.py, in a shell with ROS 2 set up"
    return _beside(source, "ros2", "node.py.txt", f"{source.name}_node.py", step=step)


def _beside(
    source: Source,
    target: str,
    template: str,
    path: str,
    values: dict[str, str] | None = None,
    step: str | None = None,
) -> Files:
    source.need_whole(target)
    name = source.name
    loader = source.template("python/model.py.txt")
    if not source.has_state:  # without the steps there is no state
        loader = loader[: loader.index("\n\nSTATE = ")] + "\n"
    written: dict[str, str | bytes] = dict(source.code())
    written[f"{name}_model.py"] = loader
    written[path] = source.template(f"{target}/{template}", values)
    return Files(written, step or f"PYTHONPATH=@OUT@ python -c 'import {path[:-3]}'")
