"""The options of `ecm compare`."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.cli.command import Data, ModelFile, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Compare a model with a table: RMSE, bias, noise floor and excess error per component."""

    model: ModelFile
    data: Data


compare = command("compare", Options, tables=True, report=True, seed=True)
