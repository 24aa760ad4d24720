"""What several test files share: a small mechanism in closed form, and the command in-process."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from ecm.cli import run
from ecm.designs import DesignSettings
from ecm.io.cache import hash_of
from ecm.io.mechanism import Mechanism
from ecm.models import PhysicsMap, physics_map
from ecm.regression.blas import one_blas_thread
from support.chromium import Page, open_chromium
from support.jobs import identify_with_kept_fem, write_smaller
from support.neck import ROOT, SHARED_DATA, Command, Done, csv_text, neck_columns
from support.products import cache_of_this_code, made_once

TESTS = ROOT / "tests"
LONGEST_FIRST = (
    "workflow/test_identify.py",
    "diagnosis/test_diagnose.py",
    "package/test_tutorial.py",
    "workflow/test_app_page.py",
    "blind_benchmark/test_blind.py",
    "models/test_export.py",
    "diagnosis/test_given_model.py",
    "package/test_wheel.py",
    "workflow/test_app.py",
    "effects/test_body_variation.py",
    "models/test_physics_model.py",
    "package/test_pages.py",
    "chain/test_chain.py",
    "blind_benchmark/test_blind_broken.py",
    "fem/test_dask.py",
    "effects/test_encoder_poses.py",
    "workflow/test_identify_with_arm.py",
)
"""Files that begin first when the tests run on several workers, so that none ends alone.

The first makes the job that the third uses on the same worker; the second needs nothing of it.
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--whole`: every case of what `make test` samples."""
    parser.addoption("--whole", action="store_true", help="every case of what is sampled")


def pytest_configure(config: pytest.Config) -> None:
    """One cache folder for all workers; share the cores among them, and so do commands.

    A command that a test starts takes half as long again where Python keeps no compiled files.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    # A shell has what it starts in the background ignore Ctrl-C, and the commands would inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if not hasattr(config, "workerinput"):
        os.environ["ECM_CACHE"] = str(cache_of_this_code())
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


@pytest.fixture(scope="session")
def products(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of what is made once a session, the same for all workers."""
    base = tmp_path_factory.getbasetemp()
    folder = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = folder / "products"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def neck_physics(products: Path) -> PhysicsMap:
    """The physics model of the neck: its FEM is in the cache folder from then on."""
    with made_once(products, "neck-physics", lambda _: physics_map(Mechanism())):
        return physics_map(Mechanism())


@pytest.fixture(scope="session")
def quick_config(products: Path) -> Iterator[Path]:
    """`examples/quick.toml` with fewer pairs."""
    name = "quick.toml"
    small = partial(write_smaller, n=180, n_test=20)
    with made_once(products, "quick-config", lambda out: small(out / name)) as folder:
        yield folder / name


@pytest.fixture(scope="session")
def quick_job(products: Path, quick_config: Path, neck_physics: PhysicsMap) -> Iterator[Path]:
    """Results of `ecm identify` of those settings on two threads."""
    make = partial(identify_with_kept_fem, quick_config)
    with made_once(products, "quick", lambda out: make(out, "--threads", "2")) as job:
        yield job


@pytest.fixture(scope="module")
def chromium() -> Iterator[Page]:
    """A browser for the tests of a file."""
    with open_chromium() as started:
        yield started


@pytest.fixture
def page(chromium: Page) -> Iterator[Page]:
    """A page on which nothing goes wrong unsaid."""
    yield chromium
    assert chromium.problems() == []


@pytest.fixture
def neck_csv(tmp_path: Path) -> Path:
    """A table of sixty rows with nothing beside it."""
    path = tmp_path / "neck.csv"
    path.write_text(csv_text(neck_columns()), encoding="utf-8")
    return path


@pytest.fixture
def ecm_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
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
        # The search finds the same poses long before the limit of the default.
        patch.setattr("blind_parts.plans.DesignSettings", partial(DesignSettings, iterations=600))
        yield tmp_path_factory.mktemp("blind")


@pytest.fixture(scope="session")
def solids() -> Path:
    """The folder where `other_sets.table_of` keeps what FEM says of its bodies, also for later."""
    made_by = (ROOT / "benches" / "blind_parts" / "other_bodies.py").read_text(encoding="utf-8")
    folder = Path(os.environ["ECM_CACHE"]) / f"solids-{hash_of(made_by)[:16]}"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of published measurements beside the repository; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("published measurements: no folder ../shared/data beside the repository")
    return SHARED_DATA
