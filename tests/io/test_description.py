"""NAME.toml: what it may say, and the message where it says something else."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecm.errors import InputError
from ecm.io.description import ColumnSource, FileMeta, Instrument, Meta, Scene, read_meta
from ecm.io.settings import read_toml, write_toml
from support.neck import saved

FULL = """
[file]
kind = "continuous"
header_rows = 2
truth_sha256 = "ab"
[columns]
fx_N = { column = "Fx [kN]", scale = 1e3, offset = -0.5 }
y_m = 7
group = ["load_x", "load_y"]
[mechanism]
builtin = "tube"
length_m = 0.1
radius_m = 0.03
inner_radius_m = 0.01
young_modulus_Pa = 1e6
poisson_ratio = 0.49
[instrument]
pose_position_sd_m = 4e-5
fts_range = [400, 200, 200, 20, 20, 20]
top_from_sensor = [0, 0, 0, 1, 0, 0, 0]
zeroed_with_payload = true
[scene]
gravity_m_s2 = [0, 0, -9.81]
payload_mass_kg = 0.3
[run.2]
mount_angle_rad = 1.57
"""


def meta_of(text: str, tmp_path: Path) -> Meta:
    path = saved(tmp_path / "data.toml", text)
    return read_meta(path)


def test_every_table_is_understood(tmp_path: Path) -> None:
    meta = meta_of(FULL, tmp_path)
    assert meta.file == FileMeta("continuous", 2, "ab")
    assert meta.columns == {"fx_N": ColumnSource("Fx [kN]", 1e3, -0.5), "y_m": ColumnSource(7)}
    assert meta.group == ("load_x", "load_y")
    assert meta.length_m == 0.1
    body = meta.body()
    assert body is not None
    assert body.inner_radius_m == 0.01
    assert meta.instrument.fts_range == (400.0, 200.0, 200.0, 20.0, 20.0, 20.0)
    assert meta.scene == Scene((0.0, 0.0, -9.81), 0.3)
    assert meta.runs == {2: {"mount_angle_rad": 1.57}}


def test_what_it_says_survives_being_written(tmp_path: Path) -> None:
    meta = meta_of(FULL, tmp_path)
    again = Meta.from_dict(read_toml_text(meta.to_toml(), tmp_path), meta.source)
    assert again == meta


def test_saying_nothing_is_empty() -> None:
    assert Meta().empty
    assert Meta(source="somewhere").empty
    assert not Meta(instrument=Instrument(force_sd_N=0.3)).empty
    assert Meta().to_dict() == {}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[instrumnt]\n", "unknown key 'instrumnt', did you mean 'instrument'?"),
        ("[instrument]\nforce_sd = 1.0\n", "[instrument]: unknown key 'force_sd', did you mean "
         "'force_sd_N'?"),
        ("[scene]\ngravity = 9.81\n", "[scene]: unknown key 'gravity', did you mean "
         "'gravity_m_s2'?"),
        ("[file]\nheader_rows = 3\n", "[file]: header_rows = 3: expected a number from 0 to 2"),
        ("[file]\nkind = 'dynamic'\n", "expected one of static, continuous"),
        ("[mechanism]\nlength = 0.1\n", "[mechanism]: unknown key 'length', did you mean "
         "'length_m'?"),
        ("[mechanism]\nlength_m = 103.4\n", "from 0.001 to 10 (undeformed length in metres, not"),
        ("[mechanism]\nradius_m = 0.03\n", "'length_m' is missing"),
        ("[columns]\nfx = 3\n", "[columns]: 'fx' is no column name, did you mean 'fx_N'?"),
        ("[columns]\nfx_N = { colum = 3 }\n", "[columns] fx_N: unknown key 'colum'"),
        ("[columns]\nfx_N = { scale = 3.0 }\n", "the key 'column' is missing"),
        ("[columns]\nfx_N = 0\n", "column = 0: expected at least 1 (name in the file, or number"),
        ("[columns]\nfx_N = { column = 1, scale = 0.0 }\n", "expected a number other than 0"),
        ("[columns]\ngroup = [1]\n", "group = [1]: expected a list of column names"),
        ("[instrument]\nfts_range = [1, 2]\n", "fts_range has 2 entries: expected a list of 6"),
        ("[instrument]\nforce_sd_N = '0.3'\n", "force_sd_N = '0.3': expected a number"),
        ("[instrument]\nzeroed_with_payload = 1\n", "expected true or false"),
        ("[scene]\ngravity_m_s2 = [0, 0, -9810]\n", "expected a norm of about 9.81"),
        ("[run.one]\n", "[run.one]: expected a whole number"),
        ("[run.1]\nmount_angle = 1.0\n", "[run.1]: unknown key 'mount_angle', did you mean "
         "'mount_angle_rad'?"),
        ("[file\n", "no valid TOML"),
    ],
)  # fmt: skip
def test_refusals_name_file_table_and_key(text: str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        meta_of(text, tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "data.toml"))
    assert expected in str(caught.value)


def read_toml_text(text: str, tmp_path: Path) -> dict[str, object]:
    path = saved(tmp_path / "text.toml", text)
    return read_toml(path)


SCALARS = st.one_of(
    st.booleans(),
    st.integers(-(2**40), 2**40),
    st.floats(allow_nan=False),
    st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=10),
)
KEYS = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1, max_size=8
)


@given(st.dictionaries(KEYS, st.dictionaries(KEYS, SCALARS | st.lists(SCALARS, max_size=3))))
def test_written_toml_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, document: dict[str, dict[str, object]]
) -> None:
    folder = tmp_path_factory.mktemp("toml")
    assert read_toml_text(write_toml(document), folder) == document


@pytest.mark.parametrize(
    ("text", "table", "line"),
    [
        ('kind = "continuous"', "file", 'kind = "continuous"'),
        ('[mechanism]\nkind = "continuous"', "file", 'kind = "continuous"'),
        ('[columns]\nkind = "continuous"', "file", 'kind = "continuous"'),
        ("length_m = 0.1", "mechanism", "length_m = 0.1"),
        ("[scene]\nforce_sd_N = 0.2", "instrument", "force_sd_N = 0.2"),
        ("[instrument]\npayload_mass_kg = 0.3", "scene", "payload_mass_kg = 0.3"),
    ],
)
def test_a_key_in_the_wrong_table_is_told_the_right_one(
    text: str, table: str, line: str, tmp_path: Path
) -> None:
    path = saved(tmp_path / "t.toml", text + "\n")
    with pytest.raises(InputError, match=rf"belongs into \[{table}\]") as found:
        read_meta(path)
    assert found.value.remedy is not None
    shown = found.value.remedy.words
    assert f"[{table}]\n{line}\n" in shown
    # What is advised, written so, is read.
    path.write_text(f"[{table}]\n{line}\n", encoding="utf-8")
    read_meta(path)
