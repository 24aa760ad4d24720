"""What several test files share: a small mechanism in closed form, and the command in-process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ecm.cli import run
from ecm.regression.blas import one_blas_thread
from support.neck import SHARED_DATA, Done, csv_text, neck_columns


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
