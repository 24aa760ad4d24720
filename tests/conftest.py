"""What several test files share: a small mechanism in closed form, and the command in-process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ecm.cli import run
from ecm.io.columns import POSE, WRENCH
from ecm.regression.blas import one_blas_thread

F = NDArray[np.float64]
ROOT = Path(__file__).parent.parent
SHARED_DATA = ROOT.parent / "shared" / "data"
LENGTH_M = 0.1034
# The paper's equation (11), signs of our frame.
STIFFNESS = np.diag([24585.0, 3461.0, 3468.0, 4.0, 16.0, 16.0])
STIFFNESS[1, 5] = STIFFNESS[5, 1] = -179.0
STIFFNESS[2, 4] = STIFFNESS[4, 2] = 178.0


@dataclass(frozen=True)
class Done:
    """What a command left: exit code and both streams."""

    code: int
    out: str
    err: str


def neck_rows(n: int, seed: int = 0) -> tuple[F, F]:
    """Poses (n, 6) and wrenches (n, 6) of a body that hardens a little with deflection."""
    random = np.random.default_rng(seed)
    poses = random.uniform(-1.0, 1.0, (n, 6)) * [0.002, 0.01, 0.01, 0.4, 0.3, 0.3]
    wrenches = poses @ STIFFNESS * (1.0 + 0.1 * np.sum(poses[:, 3:] ** 2, axis=1))[:, None]
    poses[:, 0] += LENGTH_M
    return poses, wrenches


def neck_columns(n: int = 60, seed: int = 0) -> dict[str, F]:
    """The twelve columns of such rows with a little noise."""
    poses, wrenches = neck_rows(n, seed)
    random = np.random.default_rng([seed, 1])
    noise = random.standard_normal((n, 6)) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    columns = dict(zip(POSE, poses.T, strict=True))
    return columns | dict(zip(WRENCH, (wrenches + noise).T, strict=True))


def csv_text(columns: dict[str, F]) -> str:
    """A CSV as a user's program writes it."""
    lines = [",".join(columns)]
    lines += [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


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
