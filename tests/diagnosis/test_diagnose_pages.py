"""What `ecm diagnose` prints and draws for each verdict, with a column whose name is hostile."""

from __future__ import annotations

import html
import io
import json
import re
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.cli import run
from ecm.diagnosis.summary import Summary
from ecm.io.table import Table
from ecm.report.blocks import number
from support.campaigns import campaign, diagnosis_of, model
from support.neck import Command
from support.report_pages import figures_of, open_page

HOSTILE = '</script><b>"x*y'
"""Ends a script, opens an element, ends a string of Python, and looks like a product."""


@dataclass(frozen=True)
class Told:
    """What one run of the command left."""

    document: dict[str, Any]
    out: str
    page: Path

    def text(self) -> str:
        """The page's own text without markup."""
        body = self.page.read_text(encoding="utf-8").split("<main>")[1].split("</main>")[0]
        return html.unescape(re.sub(r"<[^>]*>", "\n", body))

    def section(self, title: str) -> str:
        """The text from one section's heading on."""
        before, heading, after = self.text().partition(f"\n{title}\n")
        assert heading, f"no section {title} in {before[:200]}"
        return after


def tables() -> dict[str, Table]:
    """Nothing hidden, a payload, and a torque that follows the hostile column."""
    clean = campaign("", 1.0, 4)
    own = np.random.default_rng(0).standard_normal(len(clean))
    y = clean.column("y_m")
    strange = clean.column("tau_x_Nm") + 0.03 * own * y / y.std()
    return {
        "none": clean.with_columns({HOSTILE: own}),
        "named": campaign("payload", 1.0, 4).with_columns({HOSTILE: own}),
        "unknown": clean.with_columns({HOSTILE: own, "tau_x_Nm": strange}),
    }


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Told]:
    folder = tmp_path_factory.mktemp("pages")
    model().save(folder / "m.json")
    found = {}
    for name, table in tables().items():
        table.write(folder / f"{name}.csv")
        places = [str(folder / f"{name}.{kind}") for kind in ("csv", "json", "html")]
        out = io.StringIO()
        with redirect_stdout(out):
            code = run(
                ["diagnose", str(folder / "m.json"), places[0], "--json", places[1],
                 "--report", places[2], "--details"]
            )  # fmt: skip
        assert code == 0
        document = json.loads(Path(places[1]).read_text(encoding="utf-8"))
        assert document["verdict"] == name, document["sentence"]
        found[name] = Told(document, out.getvalue(), Path(places[2]))
    return found


@pytest.mark.parametrize("verdict", ["none", "named", "unknown"])
def test_what_the_verdict_rests_on_and_the_errors_are_told(
    verdict: str, told: dict[str, Told]
) -> None:
    found = told[verdict]
    assert found.document["sentence"] in found.out
    for rest in ("base +physics", "the base's own error over the noise +0.00"):
        assert re.search(rf"^{rest}$", found.out, re.MULTILINE)
    assert re.search(r"^source of the noise +repeats$", found.out, re.MULTILINE)
    text = found.text()
    assert "the base's own error over the noise" in text
    assert re.search(r"\nsource of the noise\s+repeats\n", text)
    for step in ("before", "after", "floor", "ceiling", "held-out rows"):
        assert f"\n{step}\n" in text
    assert found.document["warnings"]
    assert all(f"\n{warning}\n" in text for warning in found.document["warnings"])
    limits = found.section("Would have been seen from")
    assert all(f"\n{id}\n" in limits for id in found.document["detection_limits"])


def test_none_tells_its_bound_and_the_size_that_would_have_been_seen(
    told: dict[str, Told],
) -> None:
    found = told["none"]
    bound = f"{found.document['upper_bound']:.2f}"
    assert f"s < {bound}" in found.out
    assert f"below {bound} times the noise" in found.text()
    assert len(found.document["detection_limits"]) > 25
    limits = found.out.partition("Would have been seen from")[2]
    for id, item in found.document["detection_limits"].items():
        line = next(line for line in limits.splitlines() if line.startswith(f"{id} "))
        for part in (number(item["size"]), item["unit"], item["parameter"]):
            assert part in line


def test_unknown_tells_variables_nearest_effect_and_a_skeleton_that_runs(
    told: dict[str, Told],
) -> None:
    found = told["unknown"]
    unknown = found.document["unknown"]
    assert {"y_m", HOSTILE} <= set(unknown["variables"])
    section = found.section("Unknown")
    follows = f"It follows: {', '.join(unknown['variables'])}."
    assert follows in section
    assert "".join(follows.split()) in "".join(found.out.split())  # a terminal wraps it
    for part in (unknown["words"], unknown["nearest"]["id"], f"{unknown['nearest']['share']:.0%}"):
        assert part in found.out
        assert part in section
    assert unknown["skeleton"] in found.out
    assert unknown["skeleton"].strip() in section
    # The residual is drawn against the variables that matter, though it follows none alone.
    figures = figures_of(found.page)
    titles = {note["text"] for f in figures[:2] for note in f["layout"]["annotations"]}
    against = {f"against {html.escape(name, quote=False)}" for name in ("y_m", HOSTILE)}
    assert against <= titles
    # The hostile name stays a string of Python.
    code = compile(unknown["skeleton"], "skeleton", "exec")
    constants = [c for part in code.co_consts if hasattr(part, "co_consts") for c in part.co_consts]
    assert HOSTILE in constants


OPEN = """<script>
const say = (name, value) => { document.documentElement.dataset[name] = value; };
drawn.then(() => {
const menu = document.querySelector(".menus select"), options = [...menu.options];
say("names", JSON.stringify(options.map(option => option.textContent)));
menu.value = options.find(option => option.textContent.includes("script")).value;
menu.dispatchEvent(new Event("change"));
const titles = [...document.querySelectorAll(".figure text")].map(t => t.textContent);
say("title", titles.find(t => t.startsWith("against")));
});
</script></body>"""
"""After the page's own script: open the menu of variables and choose the hostile one."""


@pytest.mark.browser
@pytest.mark.parametrize("verdict", ["none", "named", "unknown"])
def test_each_page_opens_without_error_or_request_and_the_name_stays_text(
    verdict: str, told: dict[str, Told], tmp_path: Path
) -> None:
    """Labels may be bold by a tag: a name that is not escaped loses its own."""
    page = told[verdict].page
    assert page.stat().st_size < 10e6
    opened = tmp_path / "opened.html"
    text = page.read_text(encoding="utf-8").replace("</body>", OPEN)
    opened.write_text(text, encoding="utf-8")
    seen = open_page(opened, done="title")
    assert seen.attribute("error") is None
    assert seen.attribute("blocked") is None
    assert int(seen.attribute("figures") or 0) >= 5
    assert HOSTILE in json.loads(html.unescape(seen.attribute("names") or ""))
    assert html.unescape(seen.attribute("title") or "") == f"against {HOSTILE}"
    assert re.search(r'<b[^>]*>\s*"x', seen.html) is None


def test_a_single_name_says_what_else_it_may_be() -> None:
    found = diagnosis_of("payload", 1.0, 4)
    (one,) = found.look_alikes
    assert one.id == "payload"
    assert "Missing: payload (or anything of constant force at the platform)" in found.sentence()
    document = found.to_dict()
    assert document["look_alikes"][0]["apart"] == one.apart
    assert one.apart in found.report().text()


@pytest.mark.parametrize("verdict", ["none", "named", "unknown"])
def test_three_lines_come_first_and_say_what_the_report_says(
    verdict: str, told: dict[str, Told]
) -> None:
    found = told[verdict]
    summary = found.document["summary"]
    first = [f"MISSING: {summary['missing']}", f"ADD IT:  {summary['add']}",
             f"NEXT:    {summary['next']}"]  # fmt: skip
    assert found.out.splitlines()[:3] == first
    assert all(f"\n{line}\n" in found.text() for line in summary.values())


def test_the_lines_of_a_name_carry_its_size_its_error_and_the_command(
    told: dict[str, Told],
) -> None:
    document = told["named"].document
    summary, held_out = document["summary"], document["held_out"]
    mass = document["effects"][0]["parameters"]["mass"]["value"]
    assert summary["missing"].startswith("payload (a mass on the sensor's side")
    assert f"mass {mass:.3g} +- " in summary["missing"]
    assert f", or {document['look_alikes'][0]['what'].split(':')[0]};" in summary["missing"]
    assert f"{held_out['before']:.2f} -> {held_out['after']:.2f}" in summary["missing"]
    assert summary["add"].startswith(document["addition"]["remedy"]["command"])
    assert document["look_alikes"][0]["apart"] in summary["next"]


def test_a_base_that_too_few_rows_tell_asks_for_more_poses(told: dict[str, Told]) -> None:
    few = told["none"].document | {"held_out": {"before": 5.9, "after": 5.9}}
    assert Summary.of(few).next.startswith("measure more: on held-out rows physics errs 5.9")


def test_an_experiment_that_raises_no_chance_is_not_the_next_one(told: dict[str, Told]) -> None:
    named, chances = told["named"].document, {"p_correct_before": 0.561, "p_correct": 0.562}
    lone = {"action": "wait", "minutes": 30, "separates": ["payload or own_weight"], **chances}
    kept = Summary.of(named | {"next_experiment": [lone]}).next
    assert kept.startswith(named["look_alikes"][0]["apart"])
    raised = Summary.of(named | {"next_experiment": [lone | {"p_correct": 0.9}]}).next
    assert raised == "wait (30 min, chance of the right name 0.56 -> 0.90)"


def test_a_name_whose_error_rises_on_held_out_rows_asks_for_more_poses(
    told: dict[str, Told],
) -> None:
    few = told["named"].document | {"held_out": {"before": 3.8, "after": 22.9}}
    said = Summary.of(few)
    assert "too few for the error of physics to fall" in said.missing
    assert "22.9" not in said.missing
    assert said.next.startswith("measure more: these are too few")


def test_nobody_is_told_to_add_what_lets_the_model_err_more(told: dict[str, Told]) -> None:
    """An energy without symmetry holds what was named against one with it."""
    document = told["named"].document
    held = document | {
        "model": document["model"] | {"name": "energy4-general"},
        "addition": document["addition"] | {"held_out": {"before": 4.72, "after": 4.54}},
    }
    assert "# this model 4.72 -> 4.54 times the noise" in Summary.of(held).add
    held["addition"] |= {"refused": "it may be chance", "remedy": None}
    assert (
        Summary.of(held).add
        == "nothing to this model: it may be chance, 4.72 -> 4.54 times the noise"
    )


def test_the_first_line_has_no_number_that_the_data_hold_at_zero(told: dict[str, Told]) -> None:
    """Its value and its deviation are those of the mass, times a rounding."""
    document = json.loads(json.dumps(told["named"].document))
    sizes = document["effects"][0]["parameters"]
    sizes["mass_x"] |= {"value": 5e-9 * sizes["mass"]["value"], "sd": 4e-9 * sizes["mass"]["sd"]}
    assert ", mass 0.2" in Summary.of(document).missing


def test_without_details_three_lines_and_where_the_rest_is(
    tmp_path: Path, ecm_command: Command
) -> None:
    model().save(tmp_path / "m.json")
    campaign("payload", 1.0, 4).write(tmp_path / "d.csv")
    done = ecm_command("diagnose", tmp_path / "m.json", tmp_path / "d.csv")
    starts = [line.split(":")[0] for line in done.out.splitlines()]
    assert starts == ["MISSING", "ADD IT", "NEXT", "(--details"]
