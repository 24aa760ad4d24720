"""Optional packages, imported where they are needed: the one place for all extras.

`import ecm` and the commands that do not need them stay fast, and a missing package is named
together with the extra that installs it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ecm.errors import MissingExtra

_PACKAGES = {"PIL": "pillow", "sklearn": "scikit-learn"}
"""Packages whose name differs from their module's."""


def require(module: str, extra: str, purpose: str) -> Any:
    """Import a module of an optional package.

    Parameters
    ----------
    module
        Name of the module, e.g. `plotly.offline`.
    extra
        Extra of this package that installs it, as in pyproject.toml.
    purpose
        What needs it; the error message begins with it.

    Returns
    -------
    module
        The imported module.

    Raises
    ------
    MissingExtra
        Where the package is not installed.

    Examples
    --------
    >>> require("math", "data", "Reading a.parquet").sqrt(4.0)
    2.0
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingExtra(_PACKAGES.get(package, package), extra, purpose) from None
