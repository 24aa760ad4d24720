"""The table of the second blind benchmark."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from blind_parts.other_hidden import STATEMENTS
from blind_parts.other_sets import clean_wrong, right, unsaid_wrong

Result = dict[str, Any]
Test = Callable[[Result], bool]
_GOALS: tuple[tuple[str, str, Test, str, float], ...] = (
    ("one clean wrong name, all sets", "", clean_wrong, "<=", 0.03),
    ("nothing hidden: not `none`", "nothing", lambda r: not right(r), "<=", 0.02),
    ("wrong statement refused or named as what it is", "statement", right, ">=", 0.80),
)
_BESIDE: tuple[tuple[str, str, Test], ...] = (
    ("nothing hidden: any name given", "nothing", lambda r: bool(r["answer"])),
    ("one effect, s = 1: named or in a class", "known", right),
    ("one effect, s = 3: named or in a class", "known", right),
    ("one effect: one clean wrong name", "known", clean_wrong),
    ("no catalogue has it: one clean wrong name", "foreign", clean_wrong),
    ("no catalogue has it: wrong, and not in the words behind the name", "foreign", unsaid_wrong),
    ("no catalogue has it: `none`", "foreign", lambda r: r["verdict"] == "none"),
    ("wrong statement: one clean wrong name", "statement", clean_wrong),
)


def table_text(results: Sequence[Result]) -> tuple[str, bool]:
    """Markdown, and whether every goal is met."""
    lines = ["| figure | sets | goal | share | goal met |", "|---|---|---|---|---|"]
    met = True
    for what, kind, test, relation, goal in _GOALS:
        count, share = _share(results, kind, what, test)
        good = share <= goal if relation == "<=" else share >= goal
        met &= good
        said = "yes" if good else "no"
        lines.append(f"| {what} | {count} | {relation} {goal:.2f} | {share:.3f} | {said} |")
    for what, kind, test in _BESIDE:
        count, share = _share(results, kind, what, test)
        lines.append(f"| {what} | {count} |  | {share:.3f} | – |")
    lines += ["", "| stated wrongly | sets | refused or named |", "|---|---|---|"]
    for name in STATEMENTS:
        own = [r for r in results if r["set"]["name"] == name]
        if own:
            lines.append(f"| {name} | {len(own)} | {sum(map(right, own))} |")
    wrong = [r for r in results if clean_wrong(r) or not right(r)]
    lines += ["", f"Not right: {len(wrong)}."]
    lines += [f"- {_line(r)}" for r in wrong]
    return "\n".join(lines) + "\n", met


def _share(results: Sequence[Result], kind: str, what: str, test: Test) -> tuple[int, float]:
    own = [r for r in results if kind in ("", r["set"]["kind"])]
    if "s = " in what:
        strength = float(what.split("s = ")[1].split(":", maxsplit=1)[0])
        own = [r for r in own if r["set"]["strength"] == strength]
    return len(own), sum(map(test, own)) / max(1, len(own))


def _line(result: Result) -> str:
    case = result["set"]
    answer = " + ".join("|".join(members) for members in result["answer"])
    wrong = " WRONG NAME" if clean_wrong(result) else ""
    size = f" at {case['strength']:g}" if case["kind"] in ("known", "foreign") else ""
    rows = f"{case['body']}, {case['rows']} rows, {case['repeats']} repeats"
    said = f"{result['verdict']} {answer}{wrong}"
    return f"{case['index']} {case['kind']} {case['name']}{size} ({rows}): {said}"
