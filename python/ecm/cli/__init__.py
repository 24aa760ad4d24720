"""The command `ecm`: one file per command; each parses its options and calls the package."""

from __future__ import annotations

from ecm.cli.main import main, run

__all__ = ["main", "run"]
