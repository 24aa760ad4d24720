"""Writes the demo of `ecm app` as one page without a server, for the site of the documentation.

.venv/bin/python docs/demo_page.py site/demo.html

It goes round the loop of the demo: campaign, physics, diagnosis, the named effect, the truth.
"""

from __future__ import annotations

import argparse
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

from ecm.workflow.app.copying import copy_of
from ecm.workflow.app.server import App, begin


def step(app: App, verb: str, **request: Any) -> dict[str, Any]:
    """Take a step to its end, with what follows it; the state then."""
    if verb != "example":
        app.jobs.start(verb, request)
    app.jobs.wait()
    state = app.state()
    failed = [item["message"] for item in state["steps"] if item["status"] == "failed"]
    if failed:
        raise SystemExit(failed[-1])
    for warning in state["pending"]:
        app.session.accept(warning)
    return state


def main() -> None:
    """Go round the loop, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    page = parser.parse_args().page
    with tempfile.TemporaryDirectory() as name, closing(App(Path(name) / "neck")) as app:
        begin(app, [], demo=True)
        step(app, "example")
        step(app, "fit", model="physics")
        found = step(app, "diagnose")["diagnosis"]
        step(app, "refit", add=[members[0] for members in found["answer"]])
        step(app, "reveal")
        page.write_text(copy_of(app.session, app.views), encoding="utf-8")


if __name__ == "__main__":
    main()
