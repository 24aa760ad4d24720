"""Figures of the table from the results of the sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from blind_parts.sets import ALL_SETS, ARM, THREE

LARGEST_CLASS = 3
GOALS_ONE = {0.2: 0.80, 0.3: 0.90, 0.5: 0.95, 1.0: 0.98, 3.0: 0.99}
GOALS_TWO = {0.5: 0.85, 1.0: 0.93}
GOAL_NOTHING = 4.0 / 200.0
GOALS_FOREIGN = {0.5: 0.20, 1.0: 0.05}
OURS = "ours"
Result = dict[str, Any]


def names(answer: dict[str, Any]) -> list[list[str]]:
    """Classes that name something: of at most three."""
    return [c for c in answer["answer"] if 0 < len(c) <= LARGEST_CLASS]


def one_right(result: Result) -> bool:
    """The hidden effect is named first, alone or in a class of at most three, and nothing else."""
    hidden = result["set"]["hidden"][0][0]
    found = result[OURS]["answer"]
    return len(found) == 1 and hidden in found[0] and len(found[0]) <= LARGEST_CLASS


def all_right(result: Result) -> bool:
    """Every hidden effect in a class of its own, no class left over."""
    hidden = [id for id, _ in result["set"]["hidden"]]
    found = names(result[OURS])
    if len(found) != len(hidden) or len(result[OURS]["answer"]) != len(found):
        return False
    return any(
        all(id in one for id, one in zip(hidden, order, strict=True))
        for order in permutations(found)
    )


def clean_wrong(result: Result) -> bool:
    """One single name that is not the truth."""
    hidden = [id for id, _ in result["set"]["hidden"]]
    found = result[OURS]["answer"]
    return len(found) == 1 and len(found[0]) == 1 and found[0][0] not in hidden


def honest(result: Result) -> bool:
    """The hidden effect is not testable or named, alone or in a class, and no name is wrong."""
    hidden = result["set"]["hidden"][0][0]
    answer = result[OURS]
    if clean_wrong(result):
        return False
    listed = any(item["id"] == hidden for item in answer.get("not_testable", ()))
    return listed or any(hidden in c for c in answer["answer"])


def share(values: Iterable[bool]) -> float:
    """Mean, not a number where there is nothing."""
    got = list(values)
    return float(np.mean(got)) if got else float("nan")


def _met(value: float, sign: str, goal: float) -> bool | None:
    """Whether a figure keeps its goal; None where it has none."""
    if not sign:
        return None
    return bool(value <= goal if sign == "<=" else value >= goal - 1e-9)


def tier_lines(results: Sequence[Result]) -> list[dict[str, Any]]:
    """One line per figure of discovery.md: what, sets, goal, value, goal met."""
    by = {t: [r for r in results if r["set"]["tier"] == t] for t in ALL_SETS}
    arm = {kind: [r for r in by[ARM] if bool(r["set"]["hidden"]) == kind] for kind in (True, False)}
    of_arm = float(np.mean([GOALS_ONE[_strength(r)] for r in arm[True]] or [1.0]))

    def at(tier: int, s: float) -> list[Result]:
        return [r for r in by[tier] if _strength(r) == s]

    def any_name(r: Result) -> bool:
        return bool(r[OURS]["answer"])

    figures: list[tuple[str, list[Result], str, float, Callable[[Result], bool]]] = [
        ("0: any name given", by[0], "<=", GOAL_NOTHING, any_name),
        *(
            (f"1: first or in a class, s = {s:g}", at(1, s), ">=", goal, one_right)
            for s, goal in GOALS_ONE.items()
        ),
        *(
            (f"2: both, s = {s:g}", at(2, s), ">=", goal, all_right)
            for s, goal in GOALS_TWO.items()
        ),
        ("7: all three, s = 1", by[THREE], ">=", 0.8, all_right),
        *(
            (f"3: one clean wrong name, s = {s:g}", at(3, s), "<=", goal, clean_wrong)
            for s, goal in GOALS_FOREIGN.items()
        ),
        ("4: not testable, or a class", by[4], ">=", 0.95, honest),
        # Of the plain plan's sets only those whose first answer is a class can be told apart.
        (
            "5: first answer is a class", by[5], "", 0.0,
            lambda r: bool(r[OURS]["verdict"] == "ambiguous"),
        ),
        ("5: first answer is the right single name", by[5], "", 0.0, one_named),
        (
            "5: right single name after one experiment",
            [r for r in by[5] if r.get("second")], ">=", 0.85, lambda r: one_named(r, "second"),
        ),
        ("full robot, one effect: first or in a class", arm[True], ">=", of_arm, one_right),
        ("full robot, nothing hidden: any name given", arm[False], "<=", GOAL_NOTHING, any_name),
    ]  # fmt: skip
    lines = []
    for what, own, sign, goal, test in figures:
        if own:
            value = share(test(r) for r in own)
            words = "4 of 200" if goal == GOAL_NOTHING else f"{goal:.2f}"
            lines.append({"what": what, "sets": len(own), "goal": f"{sign} {words}" if sign else "",
                          "value": value, "met": _met(value, sign, goal)})  # fmt: skip
    return lines


def one_named(result: Result, answer: str = OURS) -> bool:
    """The single name of an answer (`ours`, or `second` after an experiment) is the truth."""
    return bool(result[answer]["answer"] == [[result["set"]["hidden"][0][0]]])


def _strength(result: Result) -> float:
    hidden = result["set"]["hidden"]
    return float(hidden[0][1] if hidden else result["set"]["strength"])


def beside(results: Sequence[Result]) -> list[dict[str, Any]]:
    """The figures beside the tiers, ours only."""
    one = [r for r in results if r["set"]["tier"] == 1]
    fitted = [p for r in one for p in r.get("parameters", [])]
    ratio = [r["ours"]["held_out"]["after"] / r["oracle"] for r in one if r.get("oracle")]
    errors = [p["relative_error"] for p in fitted if p["s"] == 0.5]
    sizes = [float(len(c)) for r in one for c in r["ours"]["answer"]]
    gone = [g for r in one if (g := _gone(r)) is not None]
    shares = [float(r["same_verdict"]) for r in results if "same_verdict" in r]
    same = [float(value >= 0.999) for value in shares]
    times = [r["ours"]["seconds"] for r in results]

    def late(values: list[float]) -> float:
        return float(np.quantile(values, 0.95))

    inside = sum(p["inside"] for p in fitted)
    of = [1.0] * sum(p["of"] for p in fitted)
    # Numbers of one set hang together: the band is that of the number of fits.
    wide = 2.576 * np.sqrt(0.09 / max(len(fitted), 1))
    band = f"{0.9 - wide:.3f} to {0.9 + wide:.3f}"
    lines: list[dict[str, Any]] = []
    for what, values, figure, goal in (
        ("held-out error over the oracle's, median", ratio, np.median, "<= 1.02"),
        ("held-out error over the oracle's, 95 %", ratio, late, "<= 1.10"),
        ("relative error of parameters at s = 0.5, median", errors, np.median, "<= 0.10"),
        ("coverage of 90 % intervals", of, lambda values: inside / len(values), band),
        ("mean size of a class", sizes, np.mean, "<= 1.5"),
        ("excess error gone, median at s >= 0.5", gone, np.median, ">= 0.90"),
        ("seeds of the analysis with the verdict of the first", shares, np.mean, ">= 0.95"),
        ("sets with the same verdict for all 20 seeds", same, np.mean, ">= 0.95"),
        ("processor seconds a verdict, 95 %", times, late, "<= 10"),
    ):
        if values:
            value = float(figure(values))
            sign, _, limit = goal.partition(" ")
            met = abs(value - 0.9) <= wide if goal == band else _met(value, sign, float(limit))
            lines.append({"what": what, "sets": len(values), "value": value, "goal": goal,
                          "met": bool(met)})  # fmt: skip
    return lines


def _gone(result: Result) -> float | None:
    """Share of the excess error, sqrt(rms^2 - floor^2), that is gone; the floor is the oracle's."""
    floor, held = result.get("oracle"), result["ours"]["held_out"]
    if not floor or result["set"]["hidden"][0][1] < 0.5 or held["before"] <= floor:
        return None
    before = np.sqrt(held["before"] ** 2 - floor**2)
    after = np.sqrt(max(held["after"] ** 2 - floor**2, 0.0))
    return float(1.0 - after / before)


def failing(results: Sequence[Result]) -> list[str]:
    """One line for every set whose figure fails."""
    test = {
        0: lambda r: not r[OURS]["answer"],
        1: one_right,
        2: all_right,
        3: lambda r: not clean_wrong(r),
        4: honest,
        5: lambda r: not r.get("second") or one_named(r, "second"),
        ARM: lambda r: one_right(r) if r["set"]["hidden"] else not r[OURS]["answer"],
    }
    lines = []
    for r in results:
        case = r["set"]
        if case["tier"] in test and not test[case["tier"]](r):
            truth = " + ".join(f"{id} at {s:g}" for id, s in case["hidden"])
            truth = truth or case["strange"] or f"nothing {case['variant']}".strip()
            said = " + ".join("|".join(c) for c in r["ours"]["answer"]) or r["ours"]["verdict"]
            if r.get("second"):
                after = " + ".join("|".join(c) for c in r["second"]["answer"])
                said += f", after `{r['second']['done']}`: {after or r['second']['verdict']}"
            lines.append(
                f"tier {case['tier']} set {case['index']} ({case['source']}): {truth} -> "
                f"{r['ours']['verdict']}: {said}; first {', '.join(r['ours'].get('first', []))}"
            )
    return lines
