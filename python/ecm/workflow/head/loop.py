"""The loop through the loop: the head misses, a campaign names why, and the head hits.

A neck hides an effect. A model without it is identified and exported; in an hour in which the neck
warms the head misses its set points. A campaign on the same neck is compared and diagnosed, what is
named is added and fitted, the model is exported again, and the head carries out the same motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ecm.diagnosis import diagnose
from ecm.errors import InputError
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.workflow.head.compiled import compile_controller
from ecm.workflow.head.experiment import Figures, Record, Robot
from ecm.workflow.head.identification import Identified, measured, true_model, with_effects
from ecm.workflow.head.motions import Motion
from ecm.workflow.head.neck_wrench import HYSTERESIS, RELAXATION, TEMPERATURE
from ecm.workflow.head.plugin import build_plugin
from ecm.workflow.head.table import Bench

HIDDEN = {
    effect.effect: effect
    for effect in (
        replace(TEMPERATURE, size=-0.015),
        replace(RELAXATION, size=0.25),
        replace(HYSTERESIS, size=4e-4),
    )
}
"""What can be hidden in the neck of `ecm head`, large enough to be seen by eye."""


@dataclass(frozen=True)
class HeadLoop:
    """The head before and after the effect was found."""

    table: Table
    """The campaign."""
    before: Model
    after: Model
    named: tuple[str, ...]
    """Effects that the diagnosis names."""
    missed: Record
    hit: Record

    def lines(self) -> list[str]:
        """A few plain lines with the errors before and after."""
        old, new = self.missed.figures(), self.hit.figures()
        return [
            f"before: {self.before.name} settles {_error(old)}",
            f"named: {', '.join(self.named) or 'nothing'}",
            f"after: {self.after.name} settles {_error(new)}",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "named": list(self.named),
            "before": {"model": self.before.name, **self.missed.figures().to_dict()},
            "after": {"model": self.after.name, **self.hit.figures().to_dict()},
        }


def hidden_effect(name: str) -> Any:
    """Return an effect of `HIDDEN`; InputError for another name.

    Examples
    --------
    >>> hidden_effect("temperature_modulus").size
    -0.015
    """
    if name not in HIDDEN:
        raise InputError(
            f"--hide {name}: the head's neck can hide {', '.join(HIDDEN)}; choose one of them"
        )
    return HIDDEN[name]


def run_loop(
    bench: Bench, *, seed: int = 0, model: str = "energy6", poses: int = 50,
    motion: Motion | None = None, effects: Sequence[str] | None = None,
    say: Callable[[str], object] = lambda text: None,
) -> HeadLoop:  # fmt: skip
    """Miss, measure, diagnose, refit, export, hit.

    Parameters
    ----------
    bench
        The true neck, with what it hides; robot, body, and folder of the compiled controllers.
    seed
        Of campaign and instruments.
    model
        Short name of the model that is fitted.
    poses
        Poses of the campaign; each is visited twice.
    motion
        What the head is asked for; default an hour of warming.
    effects
        Ids that the diagnosis may name; default all.
    say
        Told what is being done.
    """
    motion = motion or bench.motions().warming()
    say("campaign on the neck")
    row = Identified(model, poses, plan="diagnosable")
    table = measured(bench.neck, row, seed, bench.mechanism)
    before = fit_model(table, model)
    say("the head with the model that lacks the effect")
    missed = _run(bench, before, motion, seed)
    say("diagnosis")
    answer = diagnose(before, table, seed=seed, effects=effects).to_dict()["answer"]
    named = tuple(members[0] for members in answer)
    after = with_effects(before, named, table)
    say("the head with the model that has it")
    return HeadLoop(table, before, after, named, missed, _run(bench, after, motion, seed))


def run_told(bench: Bench, motion: Motion, seed: int) -> Record:
    """Carry out a motion as `run_loop` does, the controller told the true neck and its memory."""
    library = compile_controller(true_model(bench.neck), bench.folder)
    return replace(_robot(bench, library), knows_the_truth=True).run(motion, seed)


def _robot(bench: Bench, library: Path) -> Robot:
    # Without integral: it would take away at rest what the model misses, and hide it.
    control = replace(bench.settings.control, integral_per_s=0.0)
    plugin = build_plugin(bench.neck.energy, bench.folder)
    return Robot(replace(bench.settings, control=control), bench.neck, library, plugin=plugin)


def _run(bench: Bench, model: Model, motion: Motion, seed: int) -> Record:
    return _robot(bench, compile_controller(model, bench.folder)).run(motion, seed)


def _error(figures: Figures) -> str:
    return f"{figures.settled_mm:.2f} mm and {figures.settled_deg:.2f} degrees off"
