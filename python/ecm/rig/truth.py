"""What is to be hidden in a rig, the sealed truth of a campaign, and the scoring of an answer.

`NAME.truth.json` holds what was hidden; the data's NAME.toml holds only its sha256.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arguments import check_arguments, path_of
from ecm.io.arrays import float_of
from ecm.io.columns import behind
from ecm.io.events import Printed
from ecm.io.settings import did_you_mean
from ecm.io.table import Table, read_table
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
    """Refused where its size is beyond `ecm.rig.inject`, as all that `parse` reads is."""

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
        strength = float_of(rest)
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
        driven: bool = False,
    ) -> Hidden:
        """`random` becomes an id that is not `taken`, and a strength where none was given.

        Without a requested strength it may become `none`; not any more where an effect was drawn
        already that was `impossible` with the plan. `streamed`: a raw stream shows what moves.
        `driven`: there are actuators, in which something may act.
        """
        if self.effect != "random":
            return self
        possible = {
            name
            for name, kind in TRUE_EFFECTS.items()
            if (streamed or not kind.only_in_motion) and (driven or not kind.of_actuators)
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


FORMAT = "ecm-truth"
VERSION = 1
_NO_MATCH = 1e6
LARGEST_CLASS = 3
"""A larger class names nothing."""


def truth_path(data: Path) -> Path:
    """Where the truth of a table lies."""
    return data.with_suffix(".truth.json")


def sealed(effects: list[dict[str, Any]], *, seed: int, salt: str) -> str:
    """The text of a truth file; its sha256 goes into the data."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "seed": seed,
        "salt": salt,
        "effects": effects,
    }
    return json.dumps(document, indent=1, sort_keys=True) + "\n"


def sha256(text: str) -> str:
    """Hash of the exact bytes of a truth file."""
    return hashlib.sha256(text.encode()).hexdigest()


def score(truth: Sequence[str], answer: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Compares hidden ids with the classes of an answer.

    A hidden effect is found when a class of at most three names holds it; every class answers for
    one effect, as many as possible being answered for. A class left over is a wrong name.

    Examples
    --------
    >>> score(["payload"], [["payload", "length_error"]])["correct"]
    True
    >>> score(["payload"], [["hysteresis"]])["missed"]
    ['payload']
    """
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to load, and no campaign needs it

    classes = [list(dict.fromkeys(members)) for members in answer]
    cost = np.full((len(truth), len(classes)), _NO_MATCH)
    for i, effect in enumerate(truth):
        for j, members in enumerate(classes):
            if effect in members and len(members) <= LARGEST_CLASS:
                cost[i, j] = len(members)
    pairs = [(i, j) for i, j in zip(*linear_sum_assignment(cost), strict=True)]
    match = {int(i): int(j) for i, j in pairs if cost[i, j] < _NO_MATCH}
    found = [
        {"id": truth[i], "class": classes[j], "named": len(classes[j]) == 1}
        for i, j in sorted(match.items())
    ]
    missed = [effect for i, effect in enumerate(truth) if i not in match]
    left = [members for j, members in enumerate(classes) if j not in match.values()]
    return {
        "truth": list(truth),
        "found": found,
        "missed": missed,
        "wrong": left,
        "correct": not missed and not left,
        "named": not missed and not left and all(f["named"] for f in found),
    }


@dataclass(frozen=True, repr=False)
class Revealed(Printed):
    """An opened truth, and the score of an answer where there is one.

    Examples
    --------
    >>> Revealed(effects=(), seed=0).text()
    'hidden: nothing'
    """

    effects: tuple[dict[str, Any], ...]
    """id, s, size, physics, parameters of each."""
    seed: int
    verdict: str = ""
    score: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        document: dict[str, Any] = {
            "schema": 1,
            "seed": self.seed,
            "effects": [dict(effect) for effect in self.effects],
        }
        if self.score is not None:
            document |= {"verdict": self.verdict, "score": self.score}
        return document

    def __str__(self) -> str:
        return self.text()

    def text(self) -> str:
        """A few plain lines."""
        lines = [] if self.effects else ["hidden: nothing"]
        for effect in self.effects:
            unit = behind(effect["parameters"].get("unit", ""))
            lines.append(
                f"hidden: {effect['id']} at s = {effect['s']:g} "
                f"({effect['physics']} of size {effect['size']:.4g}{unit})"
            )
        if self.score is not None:
            score = self.score
            for found in score["found"]:
                how = "named" if found["named"] else f"in the class {' | '.join(found['class'])}"
                lines.append(f"found: {found['id']}, {how}")
            lines += [f"missed: {name}" for name in score["missed"]]
            lines += [f"wrong: {' | '.join(members)}" for members in score["wrong"]]
            lines.append("the answer is right" if score["correct"] else "the answer is not right")
        return "\n".join(lines)


def reveal(data: Table | str | Path, answer: str | Path | dict[str, Any] | None = None) -> Revealed:
    """Opens the truth beside a table, checks its seal, and scores an answer.

    Parameters
    ----------
    data
        The measurement table, or its path.
    answer
        The report of `diagnose` (path or parsed), or nothing.

    Raises
    ------
    InputError
        No truth file, a broken seal, or an answer that is no report of diagnose.

    Examples
    --------
    A table without a sealed truth is refused:

    >>> from ecm.io.table import as_table
    >>> reveal(as_table({"x_m": [0.1], "fx_N": [1.0]}))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: ...
    """
    check_arguments(reveal, locals())
    table = read_table(data) if isinstance(data, (str, Path)) else data
    path = truth_path(Path(table.source))
    expected = table.meta.file.truth_sha256
    if not expected:
        raise InputError(
            f"{table.source}: its TOML has no truth_sha256, so nothing was hidden in it; hide "
            "something with `ecm campaign ... --hide EFFECT=S`, or seal that nothing is with "
            "`--hide none`"
        )
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the sealed truth cannot be read: {error}") from None
    if sha256(text) != expected:
        raise InputError(
            f"{path}: the seal is broken: its sha256 is {sha256(text)}, the data say {expected}. "
            "The file was changed, or belongs to other data"
        )
    document = json.loads(text)
    effects = tuple(document["effects"])
    if answer is None:
        return Revealed(effects, document["seed"])
    report = _report(answer)
    where = "answer" if isinstance(answer, dict) else str(answer)
    scored = score([e["id"] for e in effects], _classes(report, where))
    return Revealed(effects, document["seed"], str(report.get("verdict", "")), scored)


def _report(answer: str | Path | dict[str, Any]) -> dict[str, Any]:
    if isinstance(answer, dict):
        return answer
    try:
        document = json.loads(path_of(answer).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{answer}: this answer cannot be read: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"{answer}: found a {type(document).__name__}, expected diagnose's report")
    return document


def _classes(report: dict[str, Any], where: str) -> list[list[str]]:
    classes = report.get("answer")
    if not isinstance(classes, list) or not all(
        isinstance(c, list) and all(isinstance(name, str) for name in c) for c in classes
    ):
        raise InputError(
            f"{where}: found `answer` = {classes!r}, expected a list with one list of ids per "
            "missing effect, as `ecm diagnose --json` writes it"
        )
    return classes
