"""The command `ecm`: one file per command; each parses its options and calls the package."""

from __future__ import annotations

from ecm.cli.main import main as main  # the entry point of pyproject.toml
from ecm.cli.main import run

__all__ = ["run"]
