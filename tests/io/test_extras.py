"""Optional packages: imported late, and named with their extra where they are missing."""

import shlex
import sys
from importlib.metadata import PackageNotFoundError

import pytest

from ecm.errors import MissingExtra
from ecm.io.extras import require
from support.programs import ended


@pytest.mark.parametrize(
    ("module", "package"), [("plotly.offline", "plotly"), ("PIL.Image", "pillow")]
)
def test_a_missing_package_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, module: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    expected = rf"^The page needs the package {package}, .* \(extra report\)\n"
    with pytest.raises(MissingExtra, match=expected):
        require(module, "report", "The page")


@pytest.mark.parametrize("extra", ["mesh", "cad", "data", "logs", "report", "app", "robot"])
def test_the_advice_installs_the_packages_wherever_ecm_came_from(extra: str) -> None:
    """A name on an index would be that of a release; these are installed by pip from anywhere."""
    remedy = MissingExtra("x", extra, "A test").remedy
    assert remedy is not None
    program, *words = shlex.split(remedy.command)
    assert program == sys.executable
    assert words[:3] == ["-m", "pip", "install"]
    ended(program, *words[:3], "--dry-run", "--no-index", "--quiet", *words[3:])


def test_the_advice_of_a_folder_that_was_never_installed_names_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(name: str) -> list[str]:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.requires", missing)
    assert "'ecm-stiffness[logs]'" in str(MissingExtra("h5py", "logs", "A log"))


def test_a_module_that_is_there_is_returned() -> None:
    assert require("os.path", "data", "Paths") is sys.modules["os.path"]
