"""What is to be hidden in a rig: `EFFECT=S`, `random`, or several."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.errors import InputError
from ecm.rig.draws import CORE, DRAWS, Random
from ecm.rig.fields import nearest

RANDOM_STRENGTHS = (0.5, 1.0, 3.0)
"""`--hide random` takes one of these."""


@dataclass(frozen=True)
class Hidden:
    """An effect to be hidden, at a strength s."""

    effect: str
    strength: float

    @staticmethod
    def parse(text: str) -> tuple[Hidden, ...]:
        """`EFFECT=S`, `EFFECT` (s = 1) or `random`; several with commas; () of an empty text.

        Raises
        ------
        InputError
            For an id that the plant has not or that is given twice, or a strength that is no
            positive number.
        """
        if not text.strip():
            return ()
        asked = tuple(Hidden._one(part) for part in text.split(","))
        names = [h.effect for h in asked]
        if len(set(names)) < len(names):
            raise InputError(f"--hide {text}: an effect is given twice; expected each once")
        return asked

    @staticmethod
    def _one(text: str) -> Hidden:
        name, equals, rest = text.strip().partition("=")
        name = name.strip()
        if name not in (*DRAWS, "random"):
            raise InputError(
                f"--hide {text}: the plant has no effect `{name}`{nearest(name, list(DRAWS))} "
                f"Expected random or one of {', '.join(sorted(DRAWS))}"
            )
        if not equals:
            return Hidden(name, 0.0 if name == "random" else 1.0)
        try:
            strength = float(rest)
        except ValueError:
            strength = float("nan")
        if not 0.0 < strength <= 100.0:
            raise InputError(
                f"--hide {text}: strength `{rest}`, expected a number above 0 and at most 100"
            )
        return Hidden(name, strength)

    def drawn(self, random: Random, taken: tuple[str, ...] = ()) -> Hidden:
        """`random` becomes an id that is not `taken`, and a strength where none was given."""
        if self.effect != "random":
            return self
        effect = str(random.choice(sorted(set(CORE) - set(taken))))
        strength = self.strength or float(random.choice(RANDOM_STRENGTHS))
        return Hidden(effect, strength)
