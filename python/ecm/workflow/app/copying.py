"""A session as one file: a page to read without a server, or its folder to go on with elsewhere."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

from ecm.report.page import WEB, packed, script_of, web_file
from ecm.workflow.app.jobs import FOLLOWED_BY
from ecm.workflow.app.session import INCOMING, Session
from ecm.workflow.app.views import NEED_MODEL, Views, state_of

_PAGE = Path(__file__).parent / "page"
_LINKS = """<link rel="stylesheet" href="/page/look.css">
<link rel="stylesheet" href="/page/style.css">
<script type="module" src="/page/main.js"></script>
"""
"""What a server gives to the page."""
_POLICY = """<meta http-equiv="Content-Security-Policy" content="default-src 'none';
 script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:">
"""
_BEGIN = """unpacked("packed-session").then(text => {
  globalThis.recorded = JSON.parse(text);
  return run("packed-script");
});
"""


def copy_of(session: Session, views: Views) -> str:
    """Return the page with the states of the steps that count, and all that it draws of them."""
    history, files = session.now()
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
        states.append(
            {"verb": begun.verb, "request": begun.request, "state": state_of(session, part)}
        )
        for name in ("poses", *NEED_MODEL):
            model = then.model if name in NEED_MODEL else None
            if not then.data or (name in NEED_MODEL and model is None):
                continue
            path = views.file(name, then.data, model, skip_bad_rows=files.skip_bad_rows)
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
