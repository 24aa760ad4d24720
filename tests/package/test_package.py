"""`import ecm`: every name is there, comes when it is asked for, and is what it says."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import ecm
from ecm.cli.app import COMMANDS
from ecm.io.settings import read_toml
from support.neck import ROOT, csv_text, neck_columns
from support.programs import ended


@pytest.mark.parametrize("name", ecm.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(ecm, name) is not None
    assert name in dir(ecm)


def test_type_checkers_find_the_same_names_in_the_same_modules() -> None:
    tree = ast.parse(Path(ecm.__file__).with_suffix(".pyi").read_bytes())
    stated = {
        alias.asname: (node.module, alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for node in tree.body:
        if isinstance(node, ast.Assign):
            stated[ast.unparse(node.targets[0])] = stated[ast.unparse(node.value)]
    homes = {
        name: (f"ecm.{home}", ecm._ALIASES.get(name, name)) for name, home in ecm._MODULE_OF.items()
    }
    assert stated == homes


def test_a_name_is_looked_up_once_and_another_module_may_stand_in_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert ecm.simulate is vars(ecm)["simulate"]
    stand_in = ModuleType("stand_in")
    monkeypatch.setattr(ecm, "simulate", stand_in)
    assert ecm.simulate is stand_in
    monkeypatch.undo()
    assert ecm.simulate is import_module("ecm.fem.simulate").simulate


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'ecm' has no attribute 'calibrate'"):
        _ = ecm.calibrate  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"effects", "material", "new"}))
def test_a_verb_is_a_function_and_no_module_has_its_name(name: str) -> None:
    assert callable(getattr(ecm, COMMANDS[name].work.rpartition(".")[2]))
    assert importlib.util.find_spec(f"ecm.{name}") is None


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import ecm", ("numpy", "scipy", "ecm._native")),
        ("from ecm.cli import run; run(['--version'])", ("numpy", "scipy")),
        (
            "import ecm.rig, ecm.workflow.config",
            ("scipy", "ecm.models", "ecm.diagnosis", "ecm.effects"),
        ),
    ],
)
def test_a_command_loads_only_what_it_uses(code: str, not_loaded: tuple[str, ...]) -> None:
    script = f"{code}\nimport sys\nprint([n for n in {not_loaded!r} if n in sys.modules])"
    done = ended(sys.executable, "-c", script)
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_help_of_the_program_comes_from_few_modules() -> None:
    # Each module is read from the disk where nothing is in memory yet: about 5 ms on a slow one.
    script = (
        "import sys; bare = set(sys.modules)\n"
        "from ecm.cli import run; run(['--help'])\n"
        "print(*sorted(set(sys.modules) - bare), sep=',')"
    )
    done = ended(sys.executable, "-c", script)
    modules = done.stdout.splitlines()[-1].split(",")
    assert "ecm.cli.app" in modules
    assert len(modules) < 130
    roots = {name.split(".")[0] for name in modules}
    assert roots.isdisjoint({"numpy", "scipy", "rich", "asyncio", "ssl", "http"})


THREADS = (
    "import numpy, scipy.linalg, threadpoolctl; "
    "print(sorted({p['num_threads'] for p in threadpoolctl.threadpool_info()}))"
)
"""What every BLAS of the process has, numpy's and scipy's."""


def in_a_process(*code: str) -> list[str]:
    """Lines that it prints, where BLAS would take two threads."""
    wanted = {"OPENBLAS_NUM_THREADS": "2", "MKL_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    done = ended(sys.executable, "-c", "\n".join(code), env={**os.environ, **wanted})
    return done.stdout.splitlines()


@pytest.mark.parametrize("before", ["", "import numpy", "import numpy, scipy.linalg"])
def test_blas_has_one_thread_inside_a_command(before: str, tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(csv_text(neck_columns(30)))
    done = in_a_process(
        before,
        "import ecm.cli.console, ecm.cli",
        # When the command has done its work, with all it loaded.
        "close = ecm.cli.console.Console.__exit__",
        f"def report(*a):\n    {THREADS}\n    return close(*a)",
        "ecm.cli.console.Console.__exit__ = report",
        f"print(ecm.cli.run(['check', {str(tmp_path / 'data.csv')!r}]))",
    )
    assert done[-1] == "0"
    assert "[1]" in done


def test_blas_has_one_thread_inside_a_function_and_its_own_after() -> None:
    done = in_a_process(
        "from ecm.regression.blas import one_blas_thread",
        "@one_blas_thread()\ndef inside():\n    " + THREADS,
        "inside()",
        THREADS,
    )
    assert done == ["[1]", *in_a_process(THREADS)]


def test_blas_has_its_own_threads_again_when_the_last_of_several_is_out() -> None:
    done = in_a_process(
        "import threading, numpy, scipy.linalg, threadpoolctl",
        "from ecm.regression.blas import one_blas_thread",
        "first_in, second_in, first_out = (threading.Event() for _ in range(3))",
        "def first():\n    with one_blas_thread():\n        first_in.set(); second_in.wait()",
        "def second():",
        "    first_in.wait()",
        "    with one_blas_thread():",
        "        second_in.set(); first_out.wait(); " + THREADS.partition("; ")[2],
        "one, two = threading.Thread(target=first), threading.Thread(target=second)",
        "one.start(); two.start(); one.join(); first_out.set(); two.join()",
        THREADS,
    )
    assert done == ["[1]", *in_a_process(THREADS)]


def test_blas_has_one_thread_where_the_functions_of_the_package_compute() -> None:
    done = in_a_process(
        "import ecm, numpy as np",
        f"def told(*_):\n    {THREADS}",
        "def own(poses):\n    told(); return 2e3 * poses",
        "x, time = np.sin(np.arange(60)) / 100, np.arange(60.0)",
        "fx = 2e3 * x + 0.05 * time + 0.1 * np.cos(time**2)",
        "columns = {'x_m': x, 'fx_N': fx, 'time_s': time}",
        "table = ecm.as_table(columns, meta={'instrument': {'force_sd_N': 0.1}})",
        "model = ecm.fit(table, 'linear', progress=told)",
        "ecm.cross_validate(table, 'linear', progress=told)",
        "ecm.compare(own, table, progress=told).pose_error",
        "ecm.refit(model, table, add='fts_drift', force=True, progress=told)",
    )
    assert set(done) == {"[1]"}


@pytest.mark.parametrize("rest", ["--help", "python/ecm | head -1"])
def test_the_size_is_told_without_a_traceback(rest: str) -> None:
    command = ["sh", "-c", f"{sys.executable} {ROOT}/scripts/size.py {rest}"]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stdout
    assert told.stderr == ""


def test_a_step_is_one_line_and_its_error_comes_out_whole() -> None:
    """`make demo` and the set-up run everything through scripts/step."""

    def step(script: str, **more: str) -> subprocess.CompletedProcess[str]:
        command = [ROOT / "scripts" / "step", "A step", "sh", "-c", script]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=60, env=os.environ | more
        )

    quiet = step("echo loud; echo louder >&2")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    assert re.fullmatch(r"A step +\d+ s\n", quiet.stdout), "how long depends on the machine"
    failed = step("echo first; echo second >&2; exit 3")
    assert failed.returncode == 3
    for line in ("A step", "failed after", "first", "second", "failed (3): sh -c"):
        assert line in failed.stdout
    beside = step("echo first; exit 3", BESIDE="1")  # its line comes when it is over
    assert beside.returncode == 3
    assert beside.stdout.split()[:4] == ["A", "step", "failed", "after"]
    assert "first" in beside.stdout
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    demo = makefile[makefile.index("\n$(VENV)/.demo:") :].split("\n\n")[0]
    assert "--group build --group demo" in demo
    project = read_toml(ROOT / "pyproject.toml", "project")
    # The page and the pictures come right after the demo.
    extras = project["project"]["optional-dependencies"]
    assert {*extras["app"], *extras["report"]} <= {*project["dependency-groups"]["demo"]}
    assert "--group dev" not in demo
