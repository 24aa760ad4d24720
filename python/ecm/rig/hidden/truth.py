"""The sealed truth of a campaign, and the scoring of an answer.

`NAME.truth.json` holds what was hidden; the data's NAME.toml holds only its sha256.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.table import Table, read_table

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


@dataclass(frozen=True)
class Revealed:
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

    def text(self) -> str:
        """A few plain lines."""
        lines = [] if self.effects else ["hidden: nothing"]
        for effect in self.effects:
            unit = effect["parameters"].get("unit", "")
            lines.append(
                f"hidden: {effect['id']} at s = {effect['s']:g} "
                f"({effect['physics']} of size {effect['size']:.4g} {unit})"
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
        document = json.loads(Path(answer).read_text(encoding="utf-8"))
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
