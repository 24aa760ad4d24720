"""A diagnosis in words: three lines of what is missing and what to do, and the whole report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.comparison.residual_maps import residual_figure, residual_section
from ecm.comparison.result import Comparison, workspace_blocks
from ecm.diagnosis.settings import DEFAULTS
from ecm.effects import with_shape
from ecm.effects.protocol import ABSORBED, UNKNOWN_LENGTH
from ecm.errors import Remedy
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH, behind, unit_of
from ecm.io.table import Table
from ecm.models.refit import FAR_BEYOND_NOISE
from ecm.regression.f_test import OUTLIER_CHANCE
from ecm.report.blocks import (
    Block,
    CodeBlock,
    FigureBlock,
    Report,
    Section,
    TableBlock,
    TextBlock,
    number,
)

_BY_PATH = ("hysteresis", "fts_hysteresis")


def path_taken(table: Table, named: Iterable[str]) -> list[str]:
    """Return from where each pose was taken to be reached, where a name rests on it unsaid."""
    full = table.has(*POSE, *WRENCH) and not table.continuous
    ids = [id for id in _BY_PATH if id in set(named)]
    if not ids or not full or table.has("approach"):
        return []
    return [
        f"{' and '.join(ids)}: each pose is taken as reached from that of the row before in time; "
        "where the mechanism went elsewhere between them, say so in the column approach"
    ]


LINES = (("missing", "MISSING"), ("add", "ADD IT"), ("next", "NEXT"))
"""The lines, each by its key in the report and as it is shown."""
DETAILS = "what the names rest on, the ranking, what these data cannot test or tell apart"
"""What the whole report has beside the lines."""
_NOTHING = "nothing"
_IN_SLOW_NOISE = "a pause, or the same motion again or at another speed"
"""What tells an effect from noise that changes slowly."""
_SOME_UNTESTED = 3
"""Effects that cannot be tested which the first line names, in the order of the catalogue."""


@dataclass(frozen=True)
class Summary:
    """The three lines that a person needs first.

    Examples
    --------
    >>> print(Summary("payload, 0.2 kg", "ecm refit m.json d.csv --add payload", "none is needed"))
    MISSING: payload, 0.2 kg
    ADD IT:  ecm refit m.json d.csv --add payload
    NEXT:    none is needed
    """

    missing: str
    add: str
    next: str

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Summary:
        """From the report of a diagnosis, whose numbers it repeats."""
        return cls(_missing(document), _add(document), next(_next(document)))

    def __str__(self) -> str:
        return "\n".join(f"{words + ':':<9}{getattr(self, key)}" for key, words in LINES)


def _missing(document: Mapping[str, Any]) -> str:
    """What is missing, its size, and the fall of the error on which the name rests."""
    model = document["model"]
    if model["answer"] != "inputs":
        return _missing_beside(document)
    names = ", ".join(model["unused_inputs"])
    given, base = model["as_given"]["rmse"], model["base_errors"]["rmse"]
    worst = max(given, key=lambda name: given[name] / max(base[name], 1e-300))
    errs = f"{given[worst]:.3g} {unit_of(worst)} in {worst}, {model['base']} {base[worst]:.3g}"
    more = "" if document["verdict"] == "none" else f"; beside that {_missing_beside(document)}"
    return f"the model does not take {names}: {model['name']} errs {errs}{more}"


def verdict_sentence(document: Mapping[str, Any]) -> str:
    """Return the verdict as a sentence: what is missing, and what else would look like it."""
    unknown = document["unknown"] or {}
    if unknown.get("misread"):
        if document["model"].get("statement") is not None:  # said of the model already
            return "Mend that first: a base that is fitted to these rows takes it in."
        table = "statement" in unknown
        said = "The table looks misread" if table else "Something is stated wrongly"
        return f"{said}: {unknown['words']}."
    if "slow_noise" in unknown:
        return f"Missing: {_missing_beside(document)}; {_IN_SLOW_NOISE}, would."
    if document["answer"]:
        causes = " and ".join(
            " or ".join(_named(document, id, len(members) == 1) for id in members)
            for members in document["answer"]
        )
        return f"Missing: {causes}; {_fall(document)}."
    if not unknown:
        bound = document["upper_bound"]
        bounded = f"s < {bound:.2f}" if bound < np.inf else "too few rows to bound s"
        lacks = document["model"]["answer"] == "effect"  # it is said of the model that it does
        nothing = f"Nothing is missing that these data could show ({bounded})."
        return "These data have no name for it." if lacks else nothing
    nearest = unknown["nearest"]
    # The effects of a family are told already.
    near = ""
    if nearest and "family" not in document:
        near = f"; nearest is {nearest['id']} ({nearest['share']:.0%})"
    return f"Missing: {_missing_beside(document)}{near}."


def source_of_noise(document: Mapping[str, Any]) -> str:
    """Return where the noise is from, after a space; empty where it is from repeats."""
    noise = document["noise"]
    if noise.get("is_residual"):
        return " Nothing is known of the noise: give repeats or [instrument] figures."
    return {
        "declared": " The noise is as declared, not measured.",
        "assumed": " The noise is assumed: give repeats or [instrument] figures.",
    }.get(noise["source"], "")


def _named(document: Mapping[str, Any], id: str, single: bool) -> str:
    """A cause, with its way and what else would get the same single name."""
    way = (document.get("directions") or {}).get(id)
    said = "; ".join(filter(None, [way, *(_or_else(document, id) if single else [])]))
    return f"{id} ({said})" if said else id


def _or_else(document: Mapping[str, Any], id: str) -> list[str]:
    """What no catalogue has and would get the same name."""
    outside = [one["what"] for one in document["look_alikes"] if one["id"] == id]
    return [f"or {what.split(':')[0]}" for what in outside]


def _missing_beside(document: Mapping[str, Any]) -> str:
    """The same against the base."""
    likely = f"; probability {min(document['probability'], 0.99):.2f}"  # never 1: nothing shows it
    if document["answer"]:
        ways = document.get("directions") or {}
        sizes = {item["id"]: _sized(item, ways.get(item["id"])) for item in document["effects"]}
        causes = [
            f"{' or '.join(_named(document, id, False) for id in members)} "
            "(these data cannot tell them apart)"
            if len(members) > 1
            else ", ".join([sizes.get(members[0], members[0]), *_or_else(document, members[0])])
            for members in document["answer"]
        ]
        model, factor = document["model"], ""
        if model["answer"] == "effect" and "scale" in model:
            factor = f"; the wrench is {model['scale']:.3g} times that of {model['name']}"
        return f"{' and '.join(causes)}{likely}; {_fall(document)}{factor}"
    family, unknown = document.get("family"), document["unknown"]
    if family is not None:
        words = f": {unknown['words']}" if unknown["words"] else ""
        return f"a cause that follows {family['driver']}{_like(document)}{words}{likely}"
    if unknown is None:
        return _without_name(document)
    said = "something that no known effect explains: "
    if unknown["misread"]:
        said = "no effect, the table looks misread: "
    if "slow_noise" in unknown:
        said = "nothing that can be told from "
    part = " and ".join(_sized(item) for item in document["effects"])
    # What passes every check, and leaves too much to be all of it.
    beside = f"; beside it what looks like {part}, {_fall(document)}" if part else ""
    return f"{said}{unknown['words']}{beside}"


def _like(document: Mapping[str, Any]) -> str:
    """Return the known effects that follow the driver of a family, and why none is named."""
    lacking = {item["id"] for item in document["not_testable"]}
    like = document["family"]["like"]
    of_reason = {
        "none fits all of it": [f"{id}{_beyond(document, id)}" for id in like if id not in lacking],
        "not testable": [id for id in like if id in lacking],
    }
    told = [f"{reason}: {', '.join(ids)}" for reason, ids in of_reason.items() if ids]
    return f" ({'; '.join(told)})" if told else ""


def _beyond(document: Mapping[str, Any], id: str) -> str:
    """The size that an effect would need by itself, where that is beyond its bounds."""
    one = next((one for one in document["ranking"] if one["id"] == id and "bound" in one), None)
    if one is None:
        return ""
    size = f"{one['parameter']} = {one['size']:.3g}{behind(one['unit'])}"
    return f" ({size}, beyond its bound {one['bound']:.3g})"


def _without_name(document: Mapping[str, Any]) -> str:
    """What is wrong with the model where no effect is missing."""
    model, bound = document["model"], document["upper_bound"]
    given, base = (_error(model[key]) for key in ("as_given", "base_errors"))
    again = _error(model["refitted"]) if model["refitted"] else base
    errs, nothing = f"{model['name']} errs {given}", "nothing that these data could show"
    bounded = f" (below {bound:.2g} times the noise)" if bound < np.inf else ""
    refitted = f"fitted again {again}, " if model["refitted"] and again != given else ""
    alike = model.get("neighbours_alike") is not None
    factor = model.get("scale")
    times = f", whose wrench is {factor:.3g} times its own" if factor is not None else ""
    # Of nothing that is accepted: an effect that the form of the model's own may imitate.
    pairs = "".join(
        f" ({pair})" for one in document["next_experiment"] for pair in one["separates"]
    )
    said = {
        "form": f"no effect, a better form of the model: {errs}, {refitted}{model['base']} {base}",
        "numbers": f"no effect, the model's numbers are not those of this body{times}: {errs}, "
        f"fitted again {again}",
        "table": f"no effect, the table looks misread: {model.get('statement', {}).get('what')}",
        "noise": f"{nothing}, though {errs}{' and neighbouring rows err alike' * alike}{pairs}",
        "rows": f"no effect, some rows are unlike all others: {errs}, {model['base']} {base} where "
        "they count less",
    }.get("rows" if model["reason"] == "rows" else model["answer"], f"{nothing}{bounded}")
    return f"{said}{_untested(document)}"


def _errs_far(model: Mapping[str, Any]) -> bool:
    """Whether it errs, as it stands, more than a noise that was stated half as large."""
    return (model["as_given"]["over_noise"] or 0.0) > FAR_BEYOND_NOISE


def _untested(document: Mapping[str, Any]) -> str:
    """What could be missing all the same, because nothing in these data would show it."""
    untested = document["not_testable"]
    if not untested or document["model"]["answer"] == "table":
        return ""
    # What has its columns and is hidden by the base concerns this body; the rest was not recorded.
    hidden = [item["id"] for item in untested if item["reason"].startswith(ABSORBED)]
    of_which = f", of which the base takes in {len(hidden)}" if hidden else ""
    listed = hidden or [item["id"] for item in untested]
    some = ", ".join(listed[:_SOME_UNTESTED]) + (", ..." if listed[_SOME_UNTESTED:] else "")
    return f"; not testable here: {len(untested)} effects{of_which} ({some})"


def _sized(item: Mapping[str, Any], way: str | None = None) -> str:
    """An effect, what it is and its way, its best determined parameter, the times of its shape."""
    shape = item.get("shape", {})
    effect = with_shape(item["id"], shape)
    what = effect.physics.split(":")[0].rstrip(".")
    # What the data do not tell is held near zero, and its sd: a thousandth of its size is none.
    none = {p.name: 1e-3 * p.scale for p in effect.parameters}
    fits = item["parameters"]
    name = max(fits, key=lambda at: abs(fits[at]["value"]) / (fits[at]["sd"] + none[at]))
    fitted = fits[name]
    words = what[:1].lower() + what[1:]
    size = f"{fitted['value']:.3g} +- {fitted['sd']:.2g}{behind(fitted['unit'])}"
    times = [
        f", {key.removesuffix('_s')} {value:.3g} s"
        for key, value in shape.items()
        if key.endswith("_s") and 0.0 < value < np.inf
    ]
    return f"{item['id']} ({'; '.join(filter(None, [words, way]))}), {name} {size}{''.join(times)}"


def _too_few(document: Mapping[str, Any]) -> bool:
    """Whether the rows are too few for base and effects: the error on held-out ones rises."""
    return bool(document["held_out"]["after"] > document["held_out"]["before"])


def _fall(document: Mapping[str, Any]) -> str:
    before, after = document["held_out"]["before"], document["held_out"]["after"]
    base = document["model"]["base"]
    if _too_few(document):
        return f"these rows are too few for the error of {base} to fall on others"
    if document["noise"].get("is_assumed"):
        return f"error of {base} falls to {after / max(before, 1e-300):.0%}"
    return f"error of {base} {before:.2f} -> {after:.2f} times the noise"


def _error(errors: Mapping[str, Any]) -> str:
    if errors["over_noise"] is not None:
        return f"{errors['over_noise']:.3g} times the noise"
    name, value = max(errors["rmse"].items(), key=lambda item: item[1])
    return f"{value:.3g} in {name}"


def _add(document: Mapping[str, Any]) -> str:
    """The command that puts it into the model that was given, or the one that mends the model."""
    # What it lacks otherwise comes first: beside it an effect brings this model nothing.
    first = document["model"]["answer"] == "inputs" or document["model"]["reason"] == "rows"
    if not first and (addition := document.get("addition")) is not None:
        return _added(document, addition)
    if document["answer"] and not first:
        rows = "these rows together with those of its fit"
        return f"nothing: the model has it already; refit it to {rows}"
    if (remedy := document["model"].get("remedy")) is not None:
        return _command(remedy)
    if (document["unknown"] or {}).get("skeleton"):
        return "an effect of your own: the details have a draft of it"
    return _NOTHING


def _added(document: Mapping[str, Any], addition: Mapping[str, Any]) -> str:
    """The command that adds effects, and what they bring: a remark, as a shell reads the line."""
    command = _command(addition["remedy"]) or _NOTHING
    brings = _fall_of_model(document)
    if brings and addition["remedy"] is None:
        return f"nothing to this model: {addition['refused']}, {brings}"
    if addition["refused"]:
        return f"{command}   # not to this model: the details say why"
    said = [addition["remedy"]["words"]] if addition["base"] else []
    if not document["answer"]:
        said.append("the nearest known form, which leaves a part")
    said += [f"this model {brings}"] if brings else []
    return f"{command}   # {'; '.join(said)}" if said else command


def _fall_of_model(document: Mapping[str, Any]) -> str:
    """The fall of the given model's error by the effects; empty of the base, said elsewhere."""
    before, after = (document["addition"]["held_out"][key] for key in ("before", "after"))
    of_base = document["answer"] and document["model"]["name"] == document["model"]["base"]
    if after is None or of_base:
        return ""
    if document["noise"].get("is_assumed"):
        return f"to {after / max(before, 1e-300):.0%} of its error"
    return f"{before:.2f} -> {after:.2f} times the noise"


def _command(remedy: Mapping[str, Any] | None) -> str:
    """The command of a remedy, or its words; empty where there is none."""
    return "" if remedy is None else Remedy(**remedy).shown or remedy["words"]


def _next(document: Mapping[str, Any]) -> Iterator[str]:
    """What to do next, the most important first."""
    unknown = document["unknown"] or {}
    if document["model"].get("statement") is not None:
        yield "mend the table; where it is right, the model was fitted to one that was not: fit it"
    elif unknown.get("misread") or document["model"]["answer"] == "table":
        yield "mend the table or its description, fit the model again, and diagnose it"
    lacking = {item["record"] for item in document["not_testable"]}
    by_length = document["base"]["kind"] == "polynomial" and UNKNOWN_LENGTH.record in lacking
    whole = set(WRENCH) <= set(document["rmse"]["before"])
    state = "state the length of the mechanism ([mechanism] length_m)"
    if by_length and whole:
        yield f"{state}: an energy is the base then"
    if "family" in document:
        family = document["family"]
        shows = "which of them, and its form" if family["drivers"] > 1 else "the form"
        yield f"{family['experiment']} ({family['minutes']} min): shows {shows}"
    if document["answer"] and _too_few(document):
        yield "measure more: these are too few for the model and what it lacks together"
    # What looks like an effect beside what is unknown comes after that.
    yield from _of_unknown(unknown)
    yield from _told_apart(document)
    if unknown or document["verdict"] == "ambiguous":
        yield "record one more column: the details list what these data cannot test"
    before, model = document["held_out"]["before"], document["model"]
    if document["verdict"] == "none":
        far = before > FAR_BEYOND_NOISE
        beyond = model["answer"] == "noise" or (far and _errs_far(model))
        if beyond and model.get("neighbours_alike") is not None:
            yield f"{_IN_SLOW_NOISE}: tells slow noise from a missing effect"
        elif beyond and document["noise"]["source"] == "declared":
            yield "measure a part twice: tells larger noise from a missing effect"
        if far:
            errs = f"{model['base']} errs {before:.2g} times the noise"
            yield f"measure more: on held-out rows {errs}"
    if document["noise"]["source"] == "assumed":
        yield "measure a part twice: the noise is only assumed"
    if by_length and not whole:  # of some axes it brings one effect or two
        yield f"{state}: more effects can be tested then"
    yield "no experiment is needed"


def _told_apart(document: Mapping[str, Any]) -> Iterator[str]:
    for best in document["next_experiment"][:1]:
        words = f"{best['action']} ({best['minutes']} min"
        if best.get("p_correct") is None:
            yield f"{words})"
            continue
        before, after = (f"{best[key]:.2f}" for key in ("p_correct_before", "p_correct"))
        if after != before:  # else it would tell nothing
            yield f"{words}, chance of the right name {before} -> {after})"
    for one in document["look_alikes"][:1]:
        yield f"{one['apart']}: tells {one['id']} from {one['what'].split(':')[0]}"


def _of_unknown(unknown: Mapping[str, Any]) -> Iterator[str]:
    if "slow_noise" in unknown:
        yield _IN_SLOW_NOISE
    if unknown.get("variables") == ["run"]:
        yield "record in a column what was set or changed between the runs: a pressure, a weight"
    elif unknown.get("variables") == ["pose"]:
        terms = "fit a model of more terms, or a smaller range"
        yield f"measure more poses where it errs most, and {terms}"
    elif unknown.get("variables", [])[:1] == ["row"]:
        yield "measure the same poses in another order, and record the time in time_s"
    elif unknown.get("variables"):
        first = unknown["variables"][:2]
        if "time_s" in first:  # nobody can vary it
            yield "the same poses again, later: the residual follows the time"
        if alone := ", then ".join(name for name in first if name != "time_s"):
            yield f"measure again and vary {alone} alone: the residual follows it"


_SHOWN = 12
_STEPS = ("before", "base", "after", "floor", "ceiling")


def diagnosis_report(
    document: Mapping[str, Any], compared: Comparison | None = None, predicted: F | None = None
) -> Report:
    """Return three lines, verdict, unknown structure, residual maps, ranking, limits, what is next.

    Of a diagnosis as plain values (`Diagnosis.to_dict`). The maps are those of the model before,
    compared with the same rows, and show what the answer adds (N, m) to the wrench of these.
    """
    lines = [[words, document["summary"][key]] for key, words in LINES]
    sections = [
        Section("In three lines", [TableBlock("", ("", ""), lines)]),
        Section("Verdict", verdict_blocks(document)),
    ]
    if document["unknown"] is not None:
        sections.append(Section("Unknown", _unknown(document["unknown"], "family" in document)))
    if compared is not None:
        sections.append(_residuals(document, compared, predicted))
    sections += [
        Section(title, [table])
        for title, table in (
            ("Next experiment", _experiments(document)),
            ("Ranking", ranking_table(document)),
            ("Not testable", not_testable_table(document)),
            ("Would have been seen from", _limits(document)),
        )
        if table.rows
    ]
    lead = f"verdict: {document['verdict']}"
    return Report("Which effect is missing", lead, sections, document["warnings"])


def verdict_blocks(document: Mapping[str, Any]) -> list[Block]:
    """Base, noise and gate, errors, sizes of what is named, what looks alike, how to add it."""
    effects = document["effects"]
    alike: dict[str, list[str]] = {}
    for first, second in document["confusable"]:
        alike.setdefault(first, []).append(second)
    tables = [
        _rests_on(document),
        *_errors(document),
        TableBlock(
            "What the accepted effects measure."
            if document["answer"]
            else "What looks like a part of it, and is no name.",
            ("effect", "parameter", "value", "± sd", "unit"),
            [
                [item["id"], name, number(p["value"], 4), p["sd"], p["unit"]]
                for item in effects
                for name, p in item["parameters"].items()
            ],
        ),
        TableBlock(
            "What is not in the catalogue and would get the same name.",
            ("effect", "or", "what tells it apart"),
            [[one["id"], one["what"], one["apart"]] for one in document["look_alikes"]],
        ),
        TableBlock(
            "What these data cannot tell apart.",
            ("effect", "looks like"),
            [[first, ", ".join(others)] for first, others in alike.items()],
        ),
    ]
    return [
        TextBlock(document["sentence"]),
        *(
            TextBlock(f"{one['id']}: {with_shape(one['id'], one.get('shape', {})).physics}")
            for one in effects
            if document["answer"]
        ),
        *(table for table in tables if table.rows),
        *_addition(document),
    ]


def _addition(document: Mapping[str, Any]) -> list[Block]:
    """What adding the effects to the given model brings, and the command."""
    addition = document.get("addition")
    if addition is None:
        return []
    text = f"Add it: {' and '.join(addition['effects'])}"
    if addition["removed"]:
        text += f" in place of {' and '.join(addition['removed'])}"
    if addition["refused"]:
        text += f" cannot be added to this model: {addition['refused']}"
    elif brings := _fall_of_model(document):
        text += f"; this model's held-out error {brings}"
    if addition["remedy"] is None:
        return [TextBlock(f"{text.rstrip('.')}.")]
    remedy = Remedy(**addition["remedy"])
    words = f" {Remedy(remedy.words)}" if addition["refused"] or addition["base"] else ""
    return [CodeBlock(f"{text.rstrip('.')}.{words}", remedy.shown)]


def _rests_on(document: Mapping[str, Any]) -> TableBlock:
    """Base, noise and gate of the verdict."""
    base, gate, noise = document["base"], document["gate"], document["noise"]
    rows = [["base", base["kind"]]]
    # Only a body's FEM has one; how far another form is off is what the tests say.
    if not noise["is_assumed"] and base["error_over_noise"] != 0.0:
        rows.append(["the base's own error over the noise", f"{base['error_over_noise']:.2f}"])
    if "mesh_error" in base:
        share = max(abs(value) for value in base["mesh_error"].values())
        left = f"{base['mesh_error_over_noise']:.2f} times the noise beside E and nu"
        left = f"up to {share:.1%} of the wrench, {left}, a direction in which the base may err"
        rows.append(["standard mesh against the fine one", left])
    source = "not known (the base's own residual weighs the components)"
    lack = f"F = {number(gate['F'])}, p = {number(gate['p'], 2)}"
    if document["verdict"] == "none" and OUTLIER_CHANCE < gate["p"] < DEFAULTS.level:
        lack += (
            ": chance, for no process of a column, of the poses before or of the pose is likelier"
        )
    rows += [
        ["source of the noise", source if noise.get("is_residual") else noise["source"]],
        ["lack of fit", lack],
    ]
    if (pattern := (document["unknown"] or {}).get("pattern")) is not None:
        rows.append([pattern["words"], f"p = {number(pattern['p'], 2)}"])
    if "rows_used" in document:
        rows.append(["rows", document["rows_used"]["sentence"]])
    if document["verdict"] == "none":
        bound = f"below {document['upper_bound']:.2f} times the noise, with 95 % confidence"
        rows.append(["what smooth functions could still hide", bound])
    return TableBlock("What the verdict rests on.", ("", ""), rows)


def _errors(document: Mapping[str, Any]) -> list[TableBlock]:
    """Error of each component, and of held-out rows over the noise, at each step."""
    errors = {**document["rmse"], "base": document["model"]["base_errors"]["rmse"]}
    held_out = document["held_out"]
    steps = [step for step in _STEPS if errors[step]]
    rows = [[name, *(errors[step].get(name) for step in steps)] for name in errors["before"]]
    floor = ". The floor is the noise" if errors["floor"] else ""
    ceiling = "; the ceiling is the base with a free cubic of the pose, on held-out rows"
    caption = (
        "Root mean square error in the unit of each column. Before: the model as given, not "
        "refitted. Base: what names are against, fitted to these rows. After: the base with the "
        f"accepted effects{floor}{ceiling if errors['ceiling'] else ''}."
    )
    unit = "the base's own residual" if document["noise"].get("is_residual") else "the noise"
    known = held_out | ({"floor": 1.0} if errors["floor"] else {})
    over_noise = {step: known[step] for step in _STEPS if step in known}
    return [
        TableBlock(caption, ("component", *steps), rows),
        TableBlock(
            f"Held-out error over {unit}. Before: the base alone.",
            ("", *over_noise),
            [["held-out rows", *over_noise.values()]],
        ),
    ]


def _unknown(unknown: Mapping[str, Any], family: bool) -> list[Block]:
    """Variables that matter, words, the nearest effect, told of a family, and a draft of one."""
    blocks: list[Block] = [TextBlock(f"What stays: {unknown['words']}.")]
    if unknown["variables"]:
        blocks.append(TextBlock(f"It follows: {', '.join(unknown['variables'])}."))
    if (nearest := unknown["nearest"]) is not None and not family:
        blocks.append(
            TextBlock(f"The nearest effect is {nearest['id']}: {nearest['share']:.0%} of it.")
        )
    if unknown["skeleton"]:
        caption = "A first draft of an effect of your own, in Python."
        blocks.append(CodeBlock(caption, unknown["skeleton"]))
    return blocks


def _limits(document: Mapping[str, Any]) -> TableBlock:
    """From which size each testable effect would have been named."""
    return TableBlock(
        "The smallest size that these data would have named with chance 0.9.",
        ("effect", "size", "unit", "parameter"),
        [
            [id, one["size"], one["unit"], one["parameter"]]
            for id, one in document["detection_limits"].items()
        ],
    )


def not_testable_table(document: Mapping[str, Any]) -> TableBlock:
    """Effects that these data cannot test, by what to record so that they can."""
    groups: dict[tuple[str, str], list[str]] = {}
    for item in document["not_testable"]:
        groups.setdefault((item["reason"], item["record"]), []).append(item["id"])
    return TableBlock(
        "Effects that these data cannot test, and what to record so that they can.",
        ("why not", "what to record", "effects"),
        [[*why, ", ".join(ids)] for why, ids in groups.items()],
    )


def _experiments(document: Mapping[str, Any]) -> TableBlock:
    """Experiments that would tell more, with their minutes."""
    rows = []
    for item in document["next_experiment"]:
        before, after = item.get("p_correct_before"), item.get("p_correct")
        chance = "not known" if after is None else f"{before:.2f} to {after:.2f}"
        rows.append([item["action"], item["minutes"], chance, "; ".join(item.get("separates", ()))])
    header = ("action", "minutes", "chance of the right name", "tells apart")
    return TableBlock("What would tell more.", header, rows)


def ranking_table(document: Mapping[str, Any]) -> TableBlock:
    """The first rows of the ranking."""
    keys = ("id", "p", "delta_bic", "size", "sd", "unit", "expected_fall")
    return TableBlock(
        "The effects in order of what each would explain alone; the last column is the fall of the "
        "error over the noise that is expected.",
        ("effect", "p", "ΔBIC", "size", "± sd", "unit", "fall"),
        [[row[key] for key in keys] for row in document["ranking"][:_SHOWN]],
    )


def _residuals(document: Mapping[str, Any], compared: Comparison, predicted: F | None) -> Section:
    unknown = document["unknown"]
    section = residual_section(compared.where(), [] if unknown is None else unknown["variables"])
    first: list[Block] = [section.blocks[0], *workspace_blocks(compared)]
    if predicted is not None:
        caption = "What the answer predicts (crosses) on the residuals of the model before."
        figure = residual_figure(compared.where(), predicted=predicted)
        first.append(FigureBlock(caption, figure))
    return replace(section, blocks=[*first, *section.blocks[1:]])
