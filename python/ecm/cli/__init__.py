"""The command `ecm`: each command parses and calls; nothing else is here."""

from __future__ import annotations

from ecm.cli.main import main, run

__all__ = ["main", "run"]
