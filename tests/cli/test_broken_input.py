"""Broken input through the command line: exit code 2, and a message with file, place, way out.

Each case writes what it needs into an empty folder, gives the arguments of `ecm`, and the pieces
that the message must hold.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from ecm._native import Mesh
from support.meshes import block_mesh
from support.neck import Command, csv_text, neck_columns, saved
from support.programs import ended

CUBIC = ("--model", "quadratic", "--out", "m.json")
NECK_TOML = "[mechanism]\nlength_m = 0.1034\n"
BODY_TOML = (
    '[mechanism]\nbuiltin = "cylinder"\nlength_m = 0.1034\nradius_m = 0.033\n'
    "young_modulus_Pa = 0.65e6\n"
)
GOOD = csv_text(neck_columns(40))
LINES = GOOD.splitlines()


def cell(line: int, column: int, text: str) -> str:
    """The good table with one cell replaced; line of the file from 1, column from 0."""
    cells = [row.split(",") for row in LINES]
    cells[line - 1][column] = text
    return "\n".join(",".join(row) for row in cells) + "\n"


def scaled(names: Sequence[str], factor: float) -> str:
    columns = neck_columns(40)
    return csv_text({k: v * factor if k in names else v for k, v in columns.items()})


def without(*names: str) -> str:
    return csv_text({k: v for k, v in neck_columns(40).items() if k not in names})


MESH_TOML = '[mechanism]\nmesh = "body.msh"\nlength_m = 0.1\nyoung_modulus_Pa = 1e6\n'


@dataclass(frozen=True)
class Case:
    """Files, arguments, and what the message must say."""

    name: str
    arguments: tuple[str, ...]
    says: tuple[str, ...]
    files: dict[str, str | bytes] = field(default_factory=dict)
    fit_first: bool = False
    """Write a good model m.json before."""


def fit(name: str, content: str | bytes, *says: str, **more: str) -> Case:
    """A table that `ecm fit` refuses; `more` holds further files."""
    files: dict[str, str | bytes] = {"d.csv": content, **more}
    return Case(name, ("fit", "d.csv", *CUBIC), (*(() if more else ("d.csv",)), *says), files)


CASES = (
    # --- tables -------------------------------------------------------------
    fit("no pose column", without(*[n for n in neck_columns(2) if n.endswith(("_m", "_rad"))]),
        "no pose column", "expected at least one of x_m", "[columns]"),
    fit("NaN", cell(7, 6, "nan"), "line 7, column 'fx_N'", "found 'nan'", "--leave-out"),
    fit("infinite", cell(3, 0, "-inf"), "line 3, column 'x_m'", "a finite number"),
    fit("empty cell", cell(9, 2, ""), "line 9, column 'z_m'", "an empty cell"),
    fit("text in a number", cell(12, 11, "n/a"), "line 12, column 'tau_z_Nm'", "found 'n/a'",
        "expected a number"),
    fit("decimal comma", cell(12, 11, '"0,5"'), "line 12", "found '0,5'", "decimal point"),
    fit("another unit in the name", GOOD.replace("fx_N", "fx_kN"), "column 'fx_kN'",
        "looks like 'fx_N'", "[columns]"),
    fit("no unit in the name", GOOD.replace("tau_z_Nm", "tau_z"), "column 'tau_z'",
        "looks like 'tau_z_Nm'"),
    fit("empty file", "", "the file is empty", "expected a header row"),
    fit("no rows", LINES[0] + "\n", "no rows of data", "expected at least one"),
    fit("duplicate column", GOOD.replace("fy_N", "fx_N"), "'fx_N' is repeated", "columns 7, 8",
        "Rename"),
    fit("ragged row", GOOD + "1.0,2.0\n", "line 42", "found 2 cells", "expected 12"),
    fit("millimetres", scaled(("x_m", "y_m", "z_m"), 1e3), "column 'x_m'", "millimetres",
        "Divide by 1000"),
    fit("degrees", scaled(("theta_x_rad", "theta_y_rad", "theta_z_rad"), 57.3),
        "column 'theta_x_rad'", "degrees", "pi/180"),
    fit("rows there twice", csv_text(neck_columns(40) | {"time_s": np.arange(40.0)})
        + csv_text(neck_columns(40) | {"time_s": np.arange(40.0)}).splitlines()[40] + "\n",
        "line 42", "identical in every column", "the same as line 41"),
    fit("time runs back", csv_text(neck_columns(40) | {"time_s": np.roll(np.arange(40.0), 1)}),
        "line 3, column 'time_s'", "found 0 after 39", "grows"),
    fit("semicolons", GOOD.replace(",", ";"), "separated by semicolons", "expected commas"),
    fit("no header", "\n".join(LINES[1:]), "the header row holds the number", "header_rows = 0"),
    fit("binary file", bytes(range(256)) * 8, "binary file", "expected a table"),
    fit("not UTF-8", GOOD.encode().replace(b"fx_N", b"f\xe9_N"), "line 1", "UTF-8"),
    fit("stray quote", GOOD.replace(LINES[4], '"' + LINES[4]), "no CSV", "stray quote"),
    fit("text column", "note,fx_N\ngood,1.0\nbad,2.0\n", "column 'note' is text in every row",
        "Remove the column"),
    fit("dates", "time_s,fx_N\n2026-03-02 13:00,1.0\n2026-03-02 13:01,2.0\n",
        "column 'time_s' is text in every row", "ecm import d.csv --out table.csv"),
    Case("directory instead of a file", ("check", "folder.csv"), ("folder.csv", "a directory"),
         {"folder.csv/x": ""}),
    Case("missing file", ("check", "dat.csv"),
         ("dat.csv", "does not exist", "Did you mean data.csv"), {"data.csv": GOOD}),
    Case("path below a file", ("check", "d.csv/inner.csv"), ("d.csv/inner.csv", "a file, not a"),
         {"d.csv": GOOD}),
    Case("output below a file", ("fit", "d.csv", "--model", "linear", "--out", "d.csv/m.json"),
         ("d.csv/m.json", "is a file, expected a directory"), {"d.csv": GOOD}),
    Case("output is a directory", ("fit", "d.csv", "--model", "linear", "--out", "folder"),
         ("folder", "expected the name of a file"), {"d.csv": GOOD, "folder/x": ""}),
    Case("Parquet that is none", ("check", "d.parquet"), ("d.parquet",), {"d.parquet": GOOD}),
    # --- description --------------------------------------------------------
    fit("unknown key", GOOD, "d.toml [instrument]", "unknown key 'force_sd'",
        "did you mean 'force_sd_N'", **{"d.toml": "[instrument]\nforce_sd = 0.3\n"}),
    fit("bad TOML", GOOD, "d.toml", "no valid TOML", "line 2",
        **{"d.toml": "[scene]\ngravity_m_s2 = [0, 0,, 0]\n"}),
    fit("column that is not there", GOOD, "d.toml [columns]", "'Dwell', which d.csv does not have",
        **{"d.toml": '[columns]\ndwell_s = "Dwell"\n'}),
    fit("group that is not there", GOOD, "group names the column 'position'",
        **{"d.toml": '[columns]\ngroup = ["position"]\n'}),
    # --- models -------------------------------------------------------------
    Case("unknown model name", ("fit", "d.csv", "--model", "cubik", "--out", "m.json"),
         ("cubik", "poly:D"), {"d.csv": GOOD}),
    Case("energy without a length", ("fit", "d.csv", "--model", "energy4", "--out", "m.json"),
         ("d.csv", "length_m"), {"d.csv": GOOD}),
    Case("rod without all columns", ("fit", "d.csv", "--model", "rod", "--out", "m.json"),
         ("d.csv", "fz_N"), {"d.csv": without("fz_N"), "d.toml": NECK_TOML}),
    Case("physics without a body", ("fit", "d.csv", "--model", "physics", "--out", "m.json"),
         ("physics", "[mechanism]"), {"d.csv": GOOD}),
    Case("threshold for an energy", ("fit", "d.csv", "--model", "energy4", "--pcr", "0.1",
         "--out", "m.json"), ("belongs to polynomials",), {"d.csv": GOOD, "d.toml": NECK_TOML}),
    Case("negative threshold", ("fit", "d.csv", "--pcr", "-1", "--out", "m.json"),
         ("--pcr", "greater than or equal to 0"), {"d.csv": GOOD}),
    Case("model file is no JSON", ("compare", "m.json", "d.csv"), ("m.json",),
         {"d.csv": GOOD, "m.json": "not a model"}),
    Case("model of another version", ("compare", "v.json", "d.csv"),
         ("v.json", "version", "2"), {"d.csv": GOOD}, fit_first=True),
    Case("damaged model file", ("compare", "damaged.json", "d.csv"), ("damaged.json", "sha256"),
         {"d.csv": GOOD}, fit_first=True),
    Case("missing model file", ("predict", "mm.json", "d.csv", "--out", "p.csv"), ("mm.json",),
         {"d.csv": GOOD}),
    Case("model needs a column", ("compare", "m.json", "few.csv"), ("few.csv", "theta_z_rad"),
         {"d.csv": GOOD, "few.csv": without("theta_z_rad")}, fit_first=True),
    Case("poses without poses", ("predict", "m.json", "w.csv", "--out", "p.csv"),
         ("w.csv", "no pose column"), {"d.csv": GOOD, "w.csv": "fx_N\n1.0\n"}, fit_first=True),
    Case("TOML without a mechanism", ("compare", "t.toml", "d.csv"), ("t.toml", "[mechanism]"),
         {"d.csv": GOOD, "t.toml": "[scene]\n"}),
    # --- configuration, mesh ------------------------------------------------
    Case("mesh turned inside out", ("simulate", "c.toml", "--out", "s.csv"),
         ("body.msh", "6 of 6 tetrahedra are inverted", "corner order"),
         {"c.toml": MESH_TOML, "body.msh": block_mesh(inside_out=True)}),
    Case("mesh without a top", ("simulate", "c.toml", "--out", "s.csv"),
         ("body.msh", "`top`"), {"c.toml": MESH_TOML, "body.msh": block_mesh(top="lid")}),
    Case("mesh that is not there", ("simulate", "c.toml", "--out", "s.csv"),
         ("body.msh", "does not exist"), {"c.toml": MESH_TOML}),
    Case("unknown key of a configuration", ("simulate", "c.toml", "--out", "s.csv"),
         ("c.toml [simulate]", "unknown key 'count'"), {"c.toml": "[simulate]\ncount = 3\n"}),
    Case("degrees in the workspace", ("identify", "c.toml", "--out", "o"),
         ("c.toml [workspace]", "degrees"), {"c.toml": "[workspace]\nrotation_limit_rad = 45\n"}),
    Case("modulus in MPa", ("simulate", "c.toml", "--out", "s.csv"),
         ("c.toml [mechanism]", "looks like MPa"), {"c.toml": BODY_TOML.replace("0.65e6", "0.65")}),
    Case("results into a file", ("identify", "c.toml", "--out", "c.toml"),
         ("c.toml", "expected a directory"), {"c.toml": ""}),
    # --- design, campaign ---------------------------------------------------
    Case("more poses than candidates", ("design", "d.csv", "--n", "41", "--model", "linear",
         "--out", "p.csv"), ("41", "40"), {"d.csv": GOOD}),
    Case("fewer poses than coefficients", ("design", "d.csv", "--n", "5", "--model", "linear",
         "--out", "p.csv"), ("5", "7"), {"d.csv": GOOD}),
    Case("no poses", ("design", "d.csv", "--n", "0", "--out", "p.csv"),
         ("--n", "x>=1"),
         {"d.csv": GOOD}),
    Case("NaN in a plan", ("campaign", "d.csv", "--rig", "r.toml", "--out", "o.csv"),
         ("ecm check d.csv --leave-out",), {"r.toml": "", "d.csv": cell(7, 1, "nan")}),
    Case("unknown key of a rig", ("campaign", "d.csv", "--rig", "r.toml", "--out", "o.csv"),
         ("r.toml [rig]", "dwell"), {"d.csv": GOOD, "r.toml": "[rig]\ndwel_s = 3\n"}),
    Case("bench of a real rig", ("campaign", "d.csv", "--rig", "b.toml", "--out", "o.csv"),
         ("b.toml: this is the file of a real rig, for ecm measure", "ecm new rig"),
         {"d.csv": GOOD, "b.toml": '[limits]\n[mover]\ndevice = "manual"\n'}),
    Case("unknown effect to hide", ("campaign", "d.csv", "--rig", "r.toml", "--out", "o.csv",
         "--hide", "fts_drif=1"), ("fts_drif", "fts_drift"),
         {"d.csv": without("fx_N"), "d.toml": BODY_TOML, "r.toml": ""}),
    Case("nothing to reveal", ("reveal", "d.csv"), ("d.csv", "truth"), {"d.csv": GOOD}),
    # --- effects ------------------------------------------------------------
    Case("unknown effect id", ("effects", "fts_drif"), ("fts_drif", "did you mean 'fts_drift'")),
    Case("effect named by a word of its physics", ("effects", "friction"),
         ("'capstan_friction'", "'hysteresis'")),
    Case("settings as a table", ("fit", "d.toml", *CUBIC), ("d.toml: a TOML",), {"d.toml": ""}),
    Case("directory as a model", ("compare", "folder", "d.csv"), ("folder", "a directory"),
         {"d.csv": GOOD, "folder/x": ""}),
    Case("model as the table of a fit", ("fit", "m.json", "--out", "n.json"),
         ("m.json is a model", "ecm fit data.csv --out n.json"), {"d.csv": GOOD}, fit_first=True),
    Case("refit with an unknown effect", ("refit", "m.json", "d.csv", "--add", "payloat", "--out",
         "n.json"), ("payloat", "did you mean 'payload'"), {"d.csv": GOOD}, fit_first=True),
    Case("removing what is not there", ("refit", "m.json", "d.csv", "--remove", "payload",
         "--out", "n.json"), ("no effect payload",), {"d.csv": GOOD}, fit_first=True),
    Case("freezing what was never fitted", ("refit", "m.json", "d.csv", "--add", "fts_offset",
         "--freeze", "fts_offset", "--out", "n.json"), ("fts_offset", "never fitted"),
         {"d.csv": GOOD}, fit_first=True),
    Case("effect that the table cannot test", ("refit", "m.json", "d.csv", "--add", "ageing",
         "--out", "n.json"), ("ageing", "time_s"), {"d.csv": GOOD}, fit_first=True),
    # --- command line -------------------------------------------------------
    Case("unknown command", ("fitt",), ("fitt", "ecm --help")),
    Case("unknown option", ("check", "d.csv", "--jsn", "x"), ("--jsn", "--json"), {"d.csv": GOOD}),
    Case("missing option", ("fit", "d.csv"), ("--out",), {"d.csv": GOOD}),
    Case("missing argument", ("check",), ("DATA",)),
    Case("overwriting a begun file", ("new", "config"), ("config.toml", "not overwritten"),
         {"config.toml": ""}),
)  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_exit_code_two_and_a_message(
    case: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ecm_command: Command,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in case.files.items():
        Path(name).parent.mkdir(exist_ok=True)
        if isinstance(content, bytes):
            Path(name).write_bytes(content)
        else:
            Path(name).write_text(content, encoding="utf-8")
    if case.fit_first:
        ecm_command("fit", "d.csv", *CUBIC).good()
        damage_copies()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    done = ecm_command(*case.arguments).refused()
    message = done.err.lower()
    for piece in case.says:
        assert piece.lower() in message, done.err
    assert done.err.lower().count("error:") == 1
    after = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert after == before, "bad input must leave no files"


def damage_copies() -> None:
    """v.json is sealed for another version; damaged.json has one digit changed."""
    text = Path("m.json").read_text(encoding="utf-8")
    document = json.loads(text)
    document["version"] = 2
    Path("v.json").write_text(json.dumps(document), encoding="utf-8")
    at = text.index("0.", text.index('"coefficients"')) + 2
    digit = "1" if text[at] != "1" else "2"
    Path("damaged.json").write_text(text[:at] + digit + text[at + 1 :], encoding="utf-8")


def test_there_are_twenty_kinds() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 20


def test_a_good_block_is_a_good_mesh(tmp_path: Path) -> None:
    """The mesh of the broken cases is right but for what is broken in it."""
    path = saved(tmp_path / "body.msh", block_mesh())
    mesh = Mesh.read(str(path))
    assert mesh.volume_m3 == pytest.approx(1e-3)
    assert mesh.length_m == pytest.approx(0.1)


def test_the_program_itself_ends_with_two_and_without_a_traceback(tmp_path: Path) -> None:
    """Once through a process of its own, as users see it."""
    (tmp_path / "d.csv").write_text(cell(7, 6, "nan"), encoding="utf-8")
    command = (sys.executable, "-m", "ecm", "check", "d.csv")
    done = ended(*command, cwd=tmp_path, env={**os.environ, "COLUMNS": "80"}, code=2)
    assert done.stderr.startswith("error: d.csv: 1 bad place:")
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
