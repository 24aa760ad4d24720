"""A release: one version everywhere, whom to cite, where to ask, and the tries of its archives."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import ZipFile

import pytest
import yaml

from ecm.io.settings import read_toml
from release import check, foreign, size, version, wheels, wine
from support.neck import ROOT

PROJECT = read_toml(ROOT / "pyproject.toml")["project"]
REPOSITORY = read_toml(ROOT / "Cargo.toml")["workspace"]["package"]["repository"]


@pytest.fixture(scope="module")
def citation() -> dict[str, Any]:
    return dict(yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8")))


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A copy of the files that state the version."""
    for name in version.STATED:
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    return tmp_path


def test_every_file_states_one_version() -> None:
    assert version.check() == version.check(f"v{version.check()}")
    crates = {path.name for path in (ROOT / "crates").iterdir()}
    assert {f"Cargo.lock, {crate}" for crate in crates} <= set(version.stated())


@pytest.mark.parametrize("name", version.STATED)
def test_a_file_of_another_version_is_found(name: str, files: Path) -> None:
    text = (files / name).read_text(encoding="utf-8")
    now = version.check(root=files)
    (files / name).write_text(text.replace(now, "9.9.9", 1), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"(?s)several versions.*{name}, .*9\.9\.9"):
        version.check(root=files)


def test_a_tag_of_another_version_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the tag v9\.9\.9 is not v"):
        version.check("v9.9.9")


def test_the_changes_of_a_version_are_its_section(files: Path) -> None:
    sections = ["# Changelog", "## Unreleased", "- c", "## 1.1.0 (2030-01-01)", "- b"]
    text = "\n\n".join([*sections, "## 1.0.0 (2029-01-01)", "- a\n"])
    (files / "CHANGELOG.md").write_text(text, encoding="utf-8")
    assert version.changes("1.1.0", files) == "- b\n"
    with pytest.raises(ValueError, match=r"no section '## 2\.0\.0"):
        version.changes("2.0.0", files)
    assert "### Added" in version.changes(version.check())


def test_addresses_are_those_of_the_repository() -> None:
    urls = PROJECT["urls"]
    assert {"Repository", "Documentation", "Changelog", "Issues", "Security"} == set(urls)
    assert urls["Repository"] == REPOSITORY
    for address in urls.values():
        assert address.startswith(REPOSITORY)
        path = re.search(r"/(?:blob|tree)/main/(.*)", address)
        assert path is None or (ROOT / path[1]).exists()


@pytest.mark.parametrize("name", ["SECURITY.md", "CODE_OF_CONDUCT.md"])
def test_who_has_something_to_report_reads_where(name: str) -> None:
    assert f"<{REPOSITORY}/security/advisories/new>" in (ROOT / name).read_text(encoding="utf-8")


def test_the_citation_is_complete(citation: dict[str, Any]) -> None:
    # What the Citation File Format 1.2.0 requires, and what a reference needs to be found.
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "license", "date-released"} <= set(citation)
    assert citation["repository-code"] == REPOSITORY
    assert set(citation["license"]) == set(PROJECT["license"].split(" OR "))
    (paper,) = citation["references"]
    assert [set(author) for author in paper["authors"]] == [{"family-names", "given-names"}] * 5
    assert re.fullmatch(r"10\.1109/LRA\.\d{4}\.\d+", paper["doi"])
    assert {"journal", "volume", "issue", "start", "end", "year"} <= set(paper)


def test_the_citation_and_the_changelog_have_one_date(citation: dict[str, Any]) -> None:
    (date,) = (line.split(", ")[1] for line in version.stated() if "CHANGELOG" in line)
    assert str(citation["date-released"]) == date


def test_a_wheel_is_refused_that_does_not_keep_its_tag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(command: list[str]) -> None:
        (Path(command[-1]) / "ecm_stiffness-0.1.0-cp310-abi3-linux_x86_64.whl").touch()

    monkeypatch.setattr(wheels, "_run", build)
    with pytest.raises(RuntimeError, match=r"linux_x86_64\.whl was built.*manylinux_2_28_x86_64"):
        wheels.build("x86_64-unknown-linux-gnu", tmp_path)
    assert list(tmp_path.iterdir()) == []


NEEDS = 'The following external shared libraries are required by the wheel: { "libc.so": null%s }'


@pytest.mark.parametrize(
    ("tag", "words", "kept"),
    [
        ("manylinux_2_28_x86_64", 'is consistent with the following platform tag: "%s"', True),
        (
            "manylinux_2_28_x86_64",
            'is consistent with the following platform tag: "linux%s"',
            False,
        ),
        ("musllinux_1_2_x86_64", NEEDS, True),
        ("musllinux_1_2_x86_64", NEEDS.replace("null", 'null, "libz.so": null'), False),
    ],
)
def test_a_wheel_that_needs_more_than_its_tag_allows_is_a_failure(
    tag: str, words: str, kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def show(command: list[str], **settings: Any) -> SimpleNamespace:
        # The C library of this machine is no text that auditwheel could read as musl's.
        assert ("--ldpaths" in command) == tag.startswith("musl")
        return SimpleNamespace(
            stdout=words.replace("%s", "" if "null" in words else tag), stderr=""
        )

    monkeypatch.setattr(wheels.subprocess, "run", show)
    wheel = tmp_path / f"ecm_stiffness-0.1.0-cp310-abi3-{tag}.whl"
    if kept:
        wheels.audit(wheel)
    else:
        with pytest.raises(RuntimeError, match="ecm_stiffness"):
            wheels.audit(wheel)


@pytest.mark.parametrize(
    ("megabytes", "seconds", "kept"), [(59.0, 0.2, True), (60.2, 0.2, False), (59.0, 0.3, False)]
)
def test_an_install_beyond_its_promise_is_a_failure(
    megabytes: float, seconds: float, kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def download(wheel: Path, python: str, folder: Path) -> float:
        asked.append(python)
        return megabytes

    monkeypatch.setattr(size, "_download", download)
    monkeypatch.setattr(size, "_run", lambda command, forget: (seconds, seconds))
    monkeypatch.setattr(size.venv, "create", lambda *given, **named: None)
    monkeypatch.setattr(size.subprocess, "run", lambda *given, **named: None)
    if kept:
        assert size.words(tmp_path / "a.whl").startswith("download 59.0 MB on 3.10, ")
    else:
        with pytest.raises(RuntimeError, match=r"at most 60 MB, 1\.0 s and 0\.25 s"):
            size.words(tmp_path / "a.whl")
    assert set(size.PYTHONS) <= set(asked)


def test_the_download_is_that_of_the_python_it_is_for(tmp_path: Path) -> None:
    wheel = tmp_path / "ecm_stiffness-0.1.0-cp310-abi3-any.whl"
    extra = 'jinja2; extra == "report"'
    with ZipFile(wheel, "w") as files:
        lines = [f"Requires-Dist: {line}" for line in (*PROJECT["dependencies"], extra)]
        files.writestr("ecm_stiffness-0.1.0.dist-info/METADATA", "\n".join(lines))
    old, new = (size.requirements(wheel, python) for python in ("3.10", "3.14"))
    assert {"numpy<2.2,>=1.26", "tomli>=2"} <= set(old)
    assert "numpy>=1.26" in new
    assert not {"jinja2", "tomli>=2"} & set(new)
    assert sum(line.startswith("numpy") for line in old) == 1


def test_every_complex_function_of_windows_has_a_definition() -> None:
    names, code = wine.complex_numbers()
    defined = set(re.findall(r"(own_\w+)\(", code))
    assert {"cabs", "crealf", "cexpl", "cpowf"} <= set(names)
    assert set(names.values()) == defined


def test_figures_of_another_machine_that_differ_are_a_failure(tmp_path: Path) -> None:
    release = check.Release(tmp_path)
    release.figures.write_text("K = 1.00\n", encoding="utf-8")
    assert release._same("K = 1.00\r\n") == "the same figures"
    with pytest.raises(RuntimeError, match=r"expected\nK = 1\.00"):
        release._same("K = 1.01\n")


def test_a_check_whose_program_is_missing_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(foreign.shutil, "which", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["check", "versions", "windows", "--work", str(tmp_path)])
    assert check.main() == 0
    first, second = capsys.readouterr().out.splitlines()
    assert re.match(r"versions +ok ", first)
    assert re.match(r"windows +not run .*apt-get install gcc-mingw-w64-x86-64", second)
