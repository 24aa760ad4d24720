"""A session as one file: a page to read without a server, a report, or its folder to go on with."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

from ecm.effects import load_installed
from ecm.models import Model, load_model
from ecm.models.physics.refit import MEASURES
from ecm.report.blocks import (
    WEB,
    Block,
    Cell,
    CodeBlock,
    FigureBlock,
    Report,
    Section,
    TableBlock,
    TextBlock,
    packed,
    script_of,
    web_file,
)
from ecm.report.figures import bars, lines
from ecm.workflow.app.jobs import FOLLOWED_BY, Views
from ecm.workflow.app.session import INCOMING, Session
from ecm.workflow.app.views import NEED_MODEL, state_of

_PAGE = Path(__file__).parent / "page"
_LINKS = """<link rel="stylesheet" href="/page/look.css">
<link rel="stylesheet" href="/page/style.css">
<script type="module" src="/page/main.js"></script>
"""
"""What a server gives to the page."""
_POLICY = """<meta http-equiv="Content-Security-Policy" content="default-src 'none';
 script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:">
"""
_IN_95 = 1.96
"""Standard deviations on both sides that hold 95 % of a normal distribution."""
_BEGIN = """unpacked("packed-session").then(text => {
  globalThis.recorded = JSON.parse(text);
  return run("packed-script");
});
"""


def copy_of(session: Session, views: Views) -> str:
    """Return the page with the states of the steps that count, and all that it draws of them."""
    history = session.journal.read()
    states: list[dict[str, Any]] = []
    begun, drawn = None, {}
    for k, number in enumerate(history.active, 1):
        step = history.steps[number]
        begun = step if begun is None or step.verb in FOLLOWED_BY else begun
        if step.verb in FOLLOWED_BY and k < len(history.active):
            continue
        taken = history.active[:k]
        part = replace(history, steps={n: history.steps[n] for n in taken}, active=taken)
        then = session.files(part)
        state = state_of(session, part)
        states.append({"verb": begun.verb, "request": begun.request, "state": state})
        for name in ("poses", *NEED_MODEL):
            model = then.model if name in NEED_MODEL else None
            if not state["check"] or (name in NEED_MODEL and model is None):
                continue
            path = views.file(name, then.data, model, skip_bad_rows=then.skip_bad_rows)
            of = "%2C".join([*then.data, *([] if model is None else [model])])
            drawn[f"/api/view/{name}?of={of}"] = json.loads(path.read_bytes())
        begun = None
    recorded = {"states": states, "views": drawn, "script": session.script()}
    html = _page_file("index.html")
    for served, own in (
        (_LINKS, f"{_POLICY}<style>\n{web_file('look.css')}{_page_file('style.css')}</style>\n"),
        ("</body>", f"{_packed('session', json.dumps(recorded, allow_nan=False))}"
         f"{_packed('script', script_of('main', folders=(WEB, _PAGE)))}"
         f"<script>\n{web_file('unpack.js')}{_BEGIN}</script>\n</body>"),
    ):  # fmt: skip
        html = html.replace(served, own)
    return html


def _packed(name: str, text: str) -> str:
    return f'<script type="text/plain" id="packed-{name}">{packed(text)}</script>\n'


def _page_file(name: str) -> str:
    return (_PAGE / name).read_text(encoding="utf-8")


def report_of(session: Session) -> Report:
    """Return the report of a session: ladder, before and after, parameters, truth, commands."""
    state = state_of(session)
    tried = [rung for rung in state["tried"] if rung["rmse"]]
    sections = [Section("Ladder of errors", _ladder(tried))]
    rungs = [rung for rung in state["rungs"] if rung["rmse"]]
    if len(rungs) > 1:
        sections.append(
            Section("Before and after", _before_and_after(rungs[0], rungs[-1], tried[-1]["floor"]))
        )
    history, files = session.now()
    if files.model is not None:
        load_installed()
        if parameters := _parameters(load_model(session.folder / files.model)):
            sections.append(Section("Parameters", [parameters]))
    found = session.result(history.last("diagnose", data=files.data))
    truth = state["truth"]
    said = [] if found is None else [TextBlock(found["summary"]["missing"], strong=True)]
    if truth is not None:
        names = ", ".join(item["id"] for item in truth["effects"]) or "nothing"
        said.append(TextBlock(f"The sealed truth: {names} was hidden."))
    if said:
        sections.append(Section("What is missing", said))
    commands = CodeBlock("They write the files of this session again.", session.script())
    sections.append(Section("Commands", [commands]))
    names = ", ".join(item["name"] for item in state["data"]) or "no table"
    return Report(f"Session {state['folder']}", f"{names}.", sections)


def _ladder(tried: Sequence[dict[str, Any]]) -> list[Block]:
    """Every fit that counts: its error over the noise beside the best of them."""
    if not tried:
        return [TextBlock("No model has been fitted yet.")]
    names = [f"{k} {rung['name']}" for k, rung in enumerate(tried, 1)]
    errors, held = (
        {name: rung[key] for name, rung in zip(names, tried, strict=True) if rung[key] is not None}
        for key in ("over_noise", "held_out")
    )
    drawn = {"fitted rows": errors, "held out": held, "noise floor": dict.fromkeys(names, 1.0)}
    series = {word: ([*of], [*of.values()]) for word, of in drawn.items()}
    rows: list[list[Cell]] = [[name, errors.get(name), held.get(name)] for name in names]
    figure = lines(series, x_title="fit", y_title="error / noise", log_y=True)
    header = ("fit", "fitted rows", "held out")
    return [
        TableBlock("The error of every fit of these rows, times the noise.", header, rows),
        FigureBlock("The same. The noise does not change with the model.", figure),
    ]


def _before_and_after(
    first: dict[str, Any], last: dict[str, Any], floor: dict[str, float]
) -> list[Block]:
    rows: list[list[Cell]] = [
        [name, first["rmse"].get(name), error, floor.get(name)]
        for name, error in last["rmse"].items()
    ]
    header = ("component", first["name"], last["name"], "noise floor")
    over = {
        rung["name"]: [rung["rmse"][name] / max(size, 1e-300) for name, size in floor.items()]
        for rung in (first, last)
    }
    return [
        TableBlock("Root mean square error of each component, in its unit.", header, rows),
        FigureBlock("The same over the noise floor.", bars(over, list(floor), y_title="error")),
    ]


def _parameters(model: Model) -> TableBlock | None:
    """What the body and the effects are; the coefficients of a polynomial tell a person nothing."""
    rows: list[list[Cell]] = []
    for name, own in model.params.items():
        what, _, short = name.rpartition(".")
        unit, scale = own.unit, 1.0
        if own.effect == "base":
            if name not in MEASURES:
                continue
            what, (short, unit, scale) = "the body", MEASURES[name]
        half = math.inf if own.sd is None else _IN_95 * own.sd
        ends = (scale * (own.value - half), scale * (own.value + half))
        rows.append([what, short, scale * own.value, *ends, unit])
    header = ("of", "parameter", "value", "from", "to", "unit")
    table = TableBlock("95 of 100 times the true value lies between the two.", header, rows)
    return table if rows else None


def archive_of(folder: Path) -> bytes:
    """Return the files of a session as a zip; the page draws its views again."""
    written = BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            left_out = inside.parts[0] in ("views", ".lock") or path.name.startswith(INCOMING)
            if path.is_file() and not left_out:
                archive.write(path, Path(folder.resolve().name) / inside)
    return written.getvalue()
