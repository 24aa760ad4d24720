"""A diagnosis on the terminal: the verdict, what it rests on, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ecm.cli.text import columns
from ecm.diagnosis.check import NotTestable, lines_by_reason
from ecm.diagnosis.sections import noise_words
from ecm.effects import with_shape
from ecm.errors import Remedy

_SHOWN = 10


def paragraphs(document: Mapping[str, Any]) -> Iterator[str]:
    """The paragraphs of a diagnosis report, the most important first."""
    yield document["sentence"]
    yield _basis(document)
    if "rows_used" in document:
        yield document["rows_used"]["sentence"]
    yield from _sizes(document)
    for one in document["look_alikes"]:
        yield f"  {one['id']}, or {one['what']} -> to tell: {one['apart']}"
    if document["verdict"] == "none":
        yield from _limits(document["detection_limits"])
    if document["unknown"] is not None:
        yield from _variables(document["unknown"])
    yield from _ranking(document)
    if document["confusable"]:
        listed = "; ".join(" = ".join(members) for members in document["confusable"])
        yield f"\nCannot be told apart with these data: {listed}"
    if document["not_testable"]:
        yield "\nNot testable with these data:"
        absent = [
            NotTestable(item["id"], item["reason"], item["record"])
            for item in document["not_testable"]
        ]
        yield from lines_by_reason(absent)
    if "addition" in document:
        yield from _addition(document["addition"])
    for item in document["next_experiment"][:3]:
        sure = ""
        if item.get("p_correct") is not None:
            before, after = item["p_correct_before"], item["p_correct"]
            sure = f", chance of the right name {before:.2f} -> {after:.2f}"
        yield f"next: {item['action']} ({item['minutes']} min{sure})"
    if document["unknown"] is not None and document["unknown"].get("skeleton"):
        yield "\nA first draft of an effect of your own:\n"
        yield document["unknown"]["skeleton"]


def _addition(addition: Mapping[str, Any]) -> Iterator[str]:
    """What adding the effects to the given model brings, and the command."""
    names, remedy = " and ".join(addition["effects"]), addition["remedy"]
    held_out = addition["held_out"]
    if addition["refused"]:
        yield f"add it: {names} cannot be added to this model: {addition['refused']}"
    elif held_out["after"] is None:
        yield f"add it: {names}"
    else:
        yield (
            f"add it: {names}; this model's held-out error {held_out['before']:.2f} -> "
            f"{held_out['after']:.2f} times the noise"
        )
    if remedy is not None:
        yield str(Remedy(**remedy)) if addition["refused"] else f"  {remedy['command']}"


def _basis(document: Mapping[str, Any]) -> str:
    base, gate = document["base"], document["gate"]
    own = f", its own error {base['error_over_noise']:.2f} times the noise"
    # Only a body's FEM has one; how far another form is off is what the tests say.
    if document["noise"].get("is_assumed") or base["error_over_noise"] == 0.0:
        own = ""
    pattern = (document["unknown"] or {}).get("pattern")
    return (
        f"base: {base['kind']}{own}; "
        f"noise: {noise_words(document['noise'])}; "
        f"lack of fit: F = {gate['F']:.3g}, p = {gate['p']:.2g}"
        + ("" if pattern is None else f"; {pattern['words']}: p = {pattern['p']:.2g}")
    )


def _sizes(document: Mapping[str, Any]) -> Iterator[str]:
    for item in document["effects"]:
        yield f"  {item['id']}: {with_shape(item['id'], item.get('shape', {})).physics}"
        for name, fitted in item["parameters"].items():
            value = f"{fitted['value']:.4g} +- {fitted['sd']:.2g} {fitted['unit']}"
            yield f"  {item['id']} {name} = {value}"


def _limits(limits: Mapping[str, Any]) -> Iterator[str]:
    """Per effect, the smallest size that would have been named."""
    if limits:
        rows = [("would have been seen", "from", "unit", "parameter")]
        for id, item in limits.items():
            rows.append((id, f"{item['size']:.2g}", item["unit"], item["parameter"]))
        yield "\n" + columns(rows)


def _variables(unknown: Mapping[str, Any]) -> Iterator[str]:
    """The variables that matter; the sentence holds words and the nearest effect."""
    shares = unknown["relevance"]
    parts = [
        f"{name} ({shares[name]:.0%})" if name in shares else name for name in unknown["variables"]
    ]
    if parts:
        yield f"variables that matter: {', '.join(parts)}"


def _ranking(document: Mapping[str, Any]) -> Iterator[str]:
    if not document["ranking"]:
        return
    rows = [("effect", "p", "delta BIC", "size", "sd", "unit", "expected fall")]
    for item in document["ranking"][:_SHOWN]:
        rows.append(
            (item["id"], f"{item['p']:.2g}", f"{item['delta_bic']:.1f}",
             f"{item['size']:.3g}", f"{item['sd']:.2g}", item["unit"],
             f"{item['expected_fall']:.3f}")
        )  # fmt: skip
    yield "\n" + columns(rows)
