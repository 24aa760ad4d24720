"""The options of `ecm check`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ecm.cli.command import Data, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Check columns and units; say what was never excited and which effects can be tested."""

    data: Data
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Record what is no measurement in NAME.toml.")
    ] = False


check = command("check", Options, tables=True)
