"""Figures of the table from the results of the sets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from blind_parts.sets import ALL_SETS, ARM, THREE

LARGEST_CLASS = 3
GOALS_ONE = {0.2: 0.80, 0.3: 0.90, 0.5: 0.95, 1.0: 0.98, 3.0: 0.99}
GOALS_TWO = {0.5: 0.85, 1.0: 0.93}
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
    """The hidden effect is listed as not testable, or is in a class, and no wrong name is given."""
    hidden = result["set"]["hidden"][0][0]
    answer = result[OURS]
    if clean_wrong(result):
        return False
    listed = any(item["id"] == hidden for item in answer.get("not_testable", ()))
    return listed or any(len(c) > 1 and hidden in c for c in answer["answer"])


def share(values: Iterable[bool]) -> float:
    """Mean, not a number where there is nothing."""
    got = list(values)
    return float(np.mean(got)) if got else float("nan")


def tier_lines(results: Sequence[Result]) -> list[dict[str, Any]]:
    """One line per figure of discovery.md: what, sets, goal, value, goal met."""
    by = {t: [r for r in results if r["set"]["tier"] == t] for t in ALL_SETS}
    lines: list[dict[str, Any]] = []

    def line(what: str, own: list[Result], goal: str, test: Any, met: Any) -> None:
        if own:
            value = share(test(r) for r in own)
            good = None if met is None else bool(met(value))
            lines.append(
                {"what": what, "sets": len(own), "goal": goal, "value": value, "met": good}
            )

    line(
        "0: any name given",
        by[0],
        "<= 4 of 200",
        lambda r: bool(r[OURS]["answer"]),
        lambda v: v <= 4.0 / 200.0,
    )
    for s, goal in GOALS_ONE.items():
        own = [r for r in by[1] if r["set"]["hidden"][0][1] == s]
        line(
            f"1: first or in a class, s = {s:g}",
            own,
            f">= {goal:.2f}",
            one_right,
            lambda v, goal=goal: v >= goal,
        )
    for s, goal in GOALS_TWO.items():
        own = [r for r in by[2] if r["set"]["hidden"][0][1] == s]
        line(
            f"2: both, s = {s:g}",
            own,
            f">= {goal:.2f}",
            all_right,
            lambda v, goal=goal: v >= goal,
        )
    line("7: all three, s = 1", by[THREE], ">= 0.80", all_right, lambda v: v >= 0.8)
    for s, goal in GOALS_FOREIGN.items():
        own = [r for r in by[3] if _strength(r) == s]
        line(
            f"3: one clean wrong name, s = {s:g}",
            own,
            f"<= {goal:.2f}",
            clean_wrong,
            lambda v, goal=goal: v <= goal,
        )
    line("4: not testable, or a class", by[4], ">= 0.95", honest, lambda v: v >= 0.95)
    # Of the plain plan's sets only those whose first answer is a class can be told apart.
    line(
        "5: first answer is a class",
        by[5],
        "",
        lambda r: r[OURS]["verdict"] == "ambiguous",
        None,
    )
    line("5: first answer is the right single name", by[5], "", one_named, None)
    line(
        "5: right single name after one experiment",
        [r for r in by[5] if r.get("second")],
        ">= 0.85",
        lambda r: one_named(r, "second"),
        lambda v: v >= 0.85,
    )
    arm = {kind: [r for r in by[ARM] if bool(r["set"]["hidden"]) == kind] for kind in (True, False)}
    goal = float(np.mean([GOALS_ONE[r["set"]["hidden"][0][1]] for r in arm[True]] or [1.0]))
    line(
        "full robot, one effect: first or in a class",
        arm[True],
        f">= {goal:.2f}",
        one_right,
        lambda v: v >= goal - 1e-9,
    )
    line(
        "full robot, nothing hidden: any name given",
        arm[False],
        "<= 4 of 200",
        lambda r: bool(r[OURS]["answer"]),
        lambda v: v <= 4.0 / 200.0,
    )
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
    lines: list[dict[str, Any]] = []

    def line(what: str, values: list[float], figure: float, goal: str, met: bool) -> None:
        if values:
            lines.append({"what": what, "sets": len(values), "value": figure, "goal": goal,
                          "met": met})  # fmt: skip

    ratio = [r["ours"]["held_out"]["after"] / r["oracle"] for r in one if r.get("oracle")]
    if ratio:
        line(
            "held-out error over the oracle's, median",
            ratio,
            float(np.median(ratio)),
            "<= 1.02",
            float(np.median(ratio)) <= 1.02,
        )
        late = float(np.quantile(ratio, 0.95))
        line("held-out error over the oracle's, 95 %", ratio, late, "<= 1.10", late <= 1.10)
    fitted = [p for r in one for p in r.get("parameters", [])]
    errors = [p["relative_error"] for p in fitted if p["s"] == 0.5]
    if errors:
        line(
            "relative error of parameters at s = 0.5, median",
            errors,
            float(np.median(errors)),
            "<= 0.10",
            float(np.median(errors)) <= 0.10,
        )
    inside, of = sum(p["inside"] for p in fitted), sum(p["of"] for p in fitted)
    if of:
        # Numbers of one set hang together: the band is that of the number of fits.
        sd = np.sqrt(0.09 / len(fitted))
        value = inside / of
        low, high = 0.9 - 2.576 * sd, 0.9 + 2.576 * sd
        line(
            "coverage of 90 % intervals",
            [1.0] * of,
            value,
            f"{low:.3f} to {high:.3f}",
            bool(low <= value <= high),
        )
    sizes = [float(len(c)) for r in one for c in r["ours"]["answer"]]
    if sizes:
        line(
            "mean size of a class",
            sizes,
            float(np.mean(sizes)),
            "<= 1.5",
            float(np.mean(sizes)) <= 1.5,
        )
    gone = [g for r in one if (g := _gone(r)) is not None]
    if gone:
        line(
            "excess error gone, median at s >= 0.5",
            gone,
            float(np.median(gone)),
            ">= 0.90",
            float(np.median(gone)) >= 0.9,
        )
    shares = [float(r["same_verdict"]) for r in results if "same_verdict" in r]
    same = [float(value >= 0.999) for value in shares]
    if same:
        line(
            "seeds of the analysis with the verdict of the first",
            shares,
            float(np.mean(shares)),
            ">= 0.95",
            float(np.mean(shares)) >= 0.95,
        )
        line(
            "sets with the same verdict for all 20 seeds",
            same,
            float(np.mean(same)),
            ">= 0.95",
            float(np.mean(same)) >= 0.95,
        )
    times = [r["ours"]["seconds"] for r in results]
    if times:
        slow = float(np.quantile(times, 0.95))
        line("processor seconds a verdict, 95 %", times, slow, "<= 10", slow <= 10.0)
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
