"""The options of `ecm check`."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.cli.command import Data, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Check columns and units; say what was never excited and which effects can be tested."""

    data: Data


check = command("check", Options, tables=True)
