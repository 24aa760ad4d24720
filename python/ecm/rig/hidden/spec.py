"""What is to be hidden in a rig: `EFFECT=S`, `random`, `none`, several, or as in another table."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.toml import did_you_mean
from ecm.rig.hidden.truth import reveal
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.physics.true_effect import Random

RANDOM_STRENGTHS = (0.5, 1.0, 3.0)
"""`--hide random` takes one of these."""
NOTHING = "none"
"""A sealed truth that holds no effect."""
NOTHING_SHARE = 0.1
"""`--hide random` hides nothing in this share of campaigns."""


@dataclass(frozen=True)
class Hidden:
    """An effect to be hidden, at a strength s.

    Examples
    --------
    >>> [(hidden.effect, hidden.strength) for hidden in Hidden.parse("hysteresis=2, payload")]
    [('hysteresis', 2.0), ('payload', 1.0)]
    """

    effect: str
    strength: float
    shape: tuple[tuple[str, Any], ...] = ()
    """Parameters of the plant, where the effect is that of an earlier campaign."""
    plausible: bool = field(default=False, compare=False)
    """Refused where its size is beyond `ecm.rig.hidden.limits`, as all that `parse` reads is."""

    @staticmethod
    def parse(text: str) -> tuple[Hidden, ...]:
        """`EFFECT=S`, `EFFECT` (s = 1), `random`, `none`; several with commas; () of no text.

        A measurement table (`first.csv`) means what is sealed beside it, at the same size.

        Raises
        ------
        InputError
            For an id that the plant has not or that is given twice, or a strength that is no
            positive number.
        """
        if not text.strip():
            return ()
        if Path(text).suffix in (".csv", ".parquet"):
            return Hidden.sealed_in(Path(text))
        effects = tuple(Hidden._one(part) for part in text.split(","))
        names = [h.effect for h in effects]
        if len(set(names)) < len(names):
            raise InputError(f"--hide {text}: an effect is given twice; expected each once")
        if NOTHING in names and len(names) > 1:
            raise InputError(f"--hide {text}: found `none` beside others; expected it alone")
        return effects

    @staticmethod
    def sealed_in(data: Path) -> tuple[Hidden, ...]:
        """What was hidden in an earlier campaign, so that another measures the same rig."""
        effects = reveal(data).effects
        if not effects:
            return (Hidden(NOTHING, 0.0),)
        return tuple(
            Hidden(e["id"], float(e["s"]), tuple(sorted(e["parameters"].items()))) for e in effects
        )

    @staticmethod
    def _one(text: str) -> Hidden:
        name, equals, rest = text.strip().partition("=")
        name = name.strip()
        if name not in (*TRUE_EFFECTS, "random", NOTHING):
            raise InputError(
                f"--hide {text}: the plant has no effect '{name}', "
                f"{did_you_mean(name, ('random', NOTHING, *sorted(TRUE_EFFECTS)))}"
            )
        if not equals:
            return Hidden(name, 0.0 if name in ("random", NOTHING) else 1.0, plausible=True)
        if name == NOTHING:
            raise InputError(f"--hide {text}: `none` takes no strength; write `none`")
        try:
            strength = float(rest)
        except ValueError:
            strength = float("nan")
        if not 0.0 < strength <= 100.0:
            raise InputError(
                f"--hide {text}: strength `{rest}`, expected a number above 0 and at most 100"
            )
        return Hidden(name, strength, plausible=True)

    def drawn(
        self,
        random: Random,
        taken: tuple[str, ...] = (),
        impossible: tuple[str, ...] = (),
        *,
        streamed: bool = False,
    ) -> Hidden:
        """`random` becomes an id that is not `taken`, and a strength where none was given.

        Without a requested strength it may become `none`; not any more where an effect was drawn
        already that was `impossible` with the plan. `streamed`: a raw stream shows what moves.
        """
        if self.effect != "random":
            return self
        possible = {
            name for name, kind in TRUE_EFFECTS.items() if streamed or not kind.only_in_motion
        }
        possible -= set(taken)
        left = sorted(possible - set(impossible))
        if not left:
            option = f"random={self.strength:g}" if self.strength else "random"
            raise InputError(
                f"--hide {option}: this plan can show none of {len(possible)} effects at "
                f"{f's = {self.strength:g}' if self.strength else 'the strengths drawn'}: each "
                "leaves no trace beside the modulus, or only at a size that nothing real has. "
                "Hide a weaker one (`random=0.5`), name one (`--hide EFFECT=S` says what hinders "
                "it), or plan with `ecm design … --preset diagnosable`"
            )
        effect = str(random.choice(left))
        if not (self.strength or taken or impossible) and random.random() < NOTHING_SHARE:
            return Hidden(NOTHING, 0.0)
        strength = self.strength or float(random.choice(RANDOM_STRENGTHS))
        return replace(self, effect=effect, strength=strength)
