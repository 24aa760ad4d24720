"""Optional packages: imported late, and named with their extra where they are missing."""

import sys

import pytest

from ecm.errors import MissingExtra
from ecm.io.extras import require


@pytest.mark.parametrize(
    ("module", "package"), [("plotly.offline", "plotly"), ("PIL.Image", "pillow")]
)
def test_a_missing_package_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, module: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    expected = rf"^The page needs the package {package}, .*'ecm-stiffness\[report\]'$"
    with pytest.raises(MissingExtra, match=expected):
        require(module, "report", "The page")


def test_a_module_that_is_there_is_returned() -> None:
    assert require("os.path", "data", "Paths") is sys.modules["os.path"]
