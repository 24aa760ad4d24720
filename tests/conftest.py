"""What several test files share: a small mechanism in closed form, and the command in-process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ecm.cli import run
from ecm.regression.blas import one_blas_thread
from support.neck import ROOT, SHARED_DATA, Done, csv_text, neck_columns

TESTS = ROOT / "tests"
LONGEST_FIRST = (
    "package/test_wheel.py",
    "workflow/test_identify.py",
    "designs/test_design.py",
    "package/test_tutorial.py",
    "package/test_readme.py",
    "blind_benchmark/test_blind.py",
    "diagnosis/test_diagnose.py",
    "fem/test_dask.py",
    "effects/test_body_variation.py",
    "models/test_physics_rod.py",
)
"""Files that begin first when the tests run on several workers, so that none ends alone."""


def pytest_configure(config: pytest.Config) -> None:
    """Share the cores among the workers: each solves on its part of them, and so do commands."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers > 1:
        os.environ.setdefault("RAYON_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let the long files begin first; a file stays on one worker (`--dist loadfile`)."""
    if not hasattr(config, "workerinput"):
        return
    order = {str(TESTS / name): i for i, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: order.get(str(item.path), len(order)))


@pytest.fixture(autouse=True, scope="session")
def _sequential_blas() -> Iterator[None]:
    """Threads of BLAS spin on small matrices: the tests take a tenth of the time without them."""
    with one_blas_thread():
        yield


@pytest.fixture
def neck_csv(tmp_path: Path) -> Path:
    """A table of sixty rows with nothing beside it."""
    path = tmp_path / "neck.csv"
    path.write_text(csv_text(neck_columns()), encoding="utf-8")
    return path


@pytest.fixture
def ecm_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Done]:
    """Run `ecm ARGUMENTS` in this process."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("ECM_DEBUG", raising=False)

    def command(*arguments: object) -> Done:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err + captured.out
        return Done(code, captured.out, captured.err)

    return command


@pytest.fixture(scope="session")
def blind_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Plans of the short blind benchmark: a third of the size, hence of the time."""
    with pytest.MonkeyPatch.context() as patch:
        for name, count in (("POSES", 45), ("VISITS", 120), ("PAPER_POSES", 60)):
            patch.setattr(f"blind_parts.plans.{name}", count)
        yield tmp_path_factory.mktemp("blind")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of published measurements beside the repository; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("published measurements: no folder ../shared/data beside the repository")
    return SHARED_DATA
