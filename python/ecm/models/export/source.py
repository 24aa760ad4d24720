"""What a target is made from and what it gives, and shared libraries by installed C compilers."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Literal

from ecm._native import export_model, seal_model
from ecm.errors import ComputationError, InputError, Remedy
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Printed
from ecm.io.extras import compiled
from ecm.models.actuated import ActuatedMap
from ecm.models.control_loop import ControlLoop, LoopSettings, not_stated, platform_for
from ecm.models.controller import AdaptSettings
from ecm.models.measured_poses import poses_like_measured, reach_of
from ecm.models.model import Model
from ecm.models.time_effects import TimeEffects, time_effects
from ecm.regression.rows import is_whole, taken_by

_FLAGS = ("-std=c99", "-O2", "-s", "-shared", "-fvisibility=hidden")
LINUX = (("cc",), ("gcc",), ("clang",))
"""Commands that compile for this machine, the first that is found is taken."""
WINDOWS = (("x86_64-w64-mingw32-gcc",),)
"""Commands that compile for Windows on x86-64."""


def shared_library(
    sources: dict[str, str], names: Sequence[str], commands: Sequence[Sequence[str]] = LINUX
) -> bytes:
    """Compile sources, in memory, to a shared library.

    Parameters
    ----------
    sources
        Text of each file by its path; headers among them.
    names
        Which of them are compiled.
    commands
        Compilers to look for.

    Returns
    -------
    bytes
        The library. Only what the sources mark as visible can be called.

    Raises
    ------
    ComputationError
        No compiler is installed, or it fails.

    Examples
    --------
    >>> shared_library({"a.c": "int a(void) { return 1; }"}, ["a.c"], [("no-such-compiler",)])
    Traceback (most recent call last):
        ...
    ecm.errors.ComputationError: no C compiler (no-such-compiler) was found; install one
    """
    command = next((c for c in commands if shutil.which(c[0])), None)
    if command is None:
        looked_for = ", ".join(c[0] for c in commands)
        raise ComputationError(f"no C compiler ({looked_for}) was found; install one")
    extra = ("-fPIC",) if commands is LINUX else ("-static-libgcc", "-Wl,--no-insert-timestamp")
    # Without paths in it, the same sources give the same bytes.
    return compiled([*command, *_FLAGS, *extra], sources, names)


Precision = Literal["double", "single"]


@dataclass(frozen=True)
class Source:
    """A model ready for export: the mechanism alone, with its effects of time beside it."""

    model: Model
    """As it was fitted."""
    inside: Model
    """Without effects beside it: those of the pose are folded into its base."""
    timed: TimeEffects
    """Effects of time that a state can hold."""
    name: str
    precision: Precision = "double"
    loop: LoopSettings | None = None
    adapt: AdaptSettings | None = None
    """Parameters that follow readings, `c` and `rust` only."""

    @property
    def has_state(self) -> bool:
        """Whether the code steps through effects of time."""
        return bool(self.timed.acting)

    @property
    def whole(self) -> bool:
        """Whether the model takes a pose to a wrench."""
        return is_whole(self.inside.base)

    def platform(self) -> tuple[float, float, tuple[str, ...]]:
        """Mass (kg) and inertia (kg m2) as for a loop, and what a reader must know of them."""
        loop = self.loop or LoopSettings()
        stiffness = self.inside.base.stiffness(self.poses(), "screw")
        mass, inertia = platform_for(stiffness, loop)
        lest = "or the simulated platform is another"
        return mass, inertia, not_stated(loop.not_stated, (mass, inertia), "The files are", lest)

    def code(self, language: Literal["c", "rust"] = "c") -> dict[str, str]:
        """Source code of the model by its path."""
        document = self.inside.document()
        if isinstance(self.inside.base, ActuatedMap):
            document |= self.inside.base.written_out()
        reach = reach_of(self.model, self.inside.base)
        if reach is not None:
            document["reach"] = reach.document()
        steps = json.dumps(self.timed.document) if self.has_state else None
        follows = None
        if self.adapt is not None:
            follows = json.dumps(self.adapt.document(self.timed, document))
        files: dict[str, str] = export_model(
            seal_model(json.dumps(document)),
            self.name,
            target=language,
            precision=self.precision,
            effects=steps,
            adapt=follows,
        )
        return files | self._steps_of_inputs(files, language == "c") | self._of_columns()

    def _of_columns(self) -> dict[str, str]:
        """What recorded columns of one's own add to the wrench, in C."""
        of_columns = self.timed.of_columns
        if not (of_columns and of_columns.effects):
            return {}
        values = of_columns.constants() | {"GUARD": self.name.upper()}
        return {
            f"{self.name}_columns.{end}": self.template(f"columns/columns.{end}.txt", values)
            for end in ("h", "c")
        }

    def _steps_of_inputs(self, files: dict[str, str], c: bool) -> dict[str, str]:
        """What takes the recorded inputs of actuators beside the code that takes those that act."""
        of_inputs = self.timed.of_inputs
        if not (of_inputs and of_inputs.acting):
            return {}
        real = {"double": "f64", "single": "f32"}[self.precision]
        values = of_inputs.constants(c) | {"GUARD": self.name.upper(), "REAL": real}
        place, ends = (f"{self.name}_steps", ("h", "c")) if c else ("src/steps", ("rs",))
        made = {f"{place}.{end}": self.template(f"inputs/steps.{end}.txt", values) for end in ends}
        return made if c else made | {"src/lib.rs": files["src/lib.rs"] + "\npub mod steps;\n"}

    @property
    def actuators(self) -> tuple[str, ...]:
        """Columns of the inputs that follow the six of the pose."""
        taken = taken_by(self.inside.base)
        return taken[len(POSE) :] if taken[: len(POSE)] == POSE else ()

    def need_whole(self, target: str, *, with_actuators: bool = False) -> None:
        """Raise InputError for a model without all six pose and wrench columns, or with more."""
        taken = taken_by(self.inside.base)
        to_c = f"ecm export MODEL --to c --out OUT --name {self.name}"
        if self.actuators and not with_actuators:
            others = "c, rust or fmu"
            if self.whole:
                others += ", mujoco, or the model at constant inputs, model.at_actuation([...])"
            raise InputError(
                f"--to {target} has no inputs for {', '.join(self.actuators)}: export to {others}",
                remedy=Remedy("export it with its inputs", to_c),
            )
        if taken[: len(POSE)] != POSE or self.inside.outputs != WRENCH:
            remedy = Remedy("export it to c", to_c)
            # What c refuses as well.
            if lost := time_effects(self.model, "c", recorded=True, columns=True).lost:
                remedy = without(list(lost), ", and export it to c")
            raise InputError(
                f"--to {target} needs a model from the six columns of the pose to the six of the "
                f"wrench; this one takes {', '.join(self.inside.inputs)} to "
                f"{', '.join(self.inside.outputs)}: export it to c, or fit a whole one",
                remedy=remedy,
            )

    def template(self, path: str, values: dict[str, str] | None = None) -> str:
        """Text of a file below `templates`, with each @KEY@ replaced by its value.

        Lines that begin with `@+` stand only with a state, those with `@-` only without.
        """
        text = (files("ecm.models.export") / "templates" / path).read_text(encoding="utf-8")
        if "@FADE@" in text:
            text = text.replace("@FADE@", self.template("inputs/fade.c.txt").rstrip())
        keep, drop = ("@+", "@-") if self.has_state else ("@-", "@+")
        lines = text.split("\n")
        text = "\n".join(line.removeprefix(keep) for line in lines if not line.startswith(drop))
        common = {
            "NAME": self.name,
            "STEPS": str(int(self.has_state)),
            "STATE": str(43 + 6 * int(self.timed.document.get("springs", 1))),
            "DOWN": " ".join(f"{x:.9g}" for x in self.model.scene.gravity_m_s2),
        }
        for key, value in {**(values or {}), **common}.items():
            text = text.replace(f"@{key}@", value)
        return text

    def poses(self, count: int = 200) -> F:
        """(count, n) measured poses and mixes of near ones."""
        return poses_like_measured(self.model, count)


def without(ids: Sequence[str], then: str) -> Remedy:
    """Fit again without effects that files cannot hold, and what comes then."""
    options = " ".join(f"--remove {id}" for id in ids)
    return Remedy(
        f"fit again without {' and '.join(ids)}{then}",
        f"ecm refit MODEL DATA {options} --out without.json",
    )


@dataclass(frozen=True, repr=False)
class Exported(Printed):
    """An exported model: what a target gives, and what `export_files` says of it.

    Examples
    --------
    >>> Exported({"spring.h": "..."}, ("Left out: fts_drift.",), ("fts_drift",)).left_out
    ('fts_drift',)
    """

    files: dict[str, str | bytes]
    """Content of each file by its path."""
    notes: tuple[str, ...] = ()
    """What a reader of the files must know."""
    left_out: tuple[str, ...] = ()
    """Ids of the effects that are not in the files."""
    loop: ControlLoop | None = None
    """The control loop of the example, where the model takes a pose to a wrench."""
    next_step: str = ""
    """The command or line that uses the files, with @OUT@ for their folder."""
    folding: float = 0.0
    """Change of the model by folding its effects into the base, over the noise."""
    folded: tuple[str, ...] = ()
    """Ids of the effects that were folded."""
    change: float = 0.0
    """Change of the model by the form that the target can hold, over the noise."""
    lost: Mapping[str, str] = field(default_factory=dict)
    """Effects beyond the noise that the files lack: words by id."""

    def __str__(self) -> str:
        return "\n".join([f"{len(self.files)} files: {', '.join(self.files)}", *self.notes])


@dataclass(frozen=True)
class Target:
    """One way to write a model."""

    write: Callable[[Source], Exported]
    language: str = "c"
    """`c` or `rust`: what holds the effects of time; `none` where nothing does."""
    precisions: tuple[Precision, ...] = ("double",)
    """Floating-point types that the files can have."""
    taken: tuple[str, ...] = ()
    """Names of files and functions that the target has itself."""
    recorded: bool = False
    """Whether its files step from the recorded inputs of actuators to those that act."""
    columns: bool = False
    """Whether its files take recorded columns of one's own."""
    robot: tuple[str, ...] = ()
    """Settings of the robot (`LoopSettings`) that its files depend on."""
