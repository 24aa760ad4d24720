"""What every model specification has: a short name, a fit, and the map of its model files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from ecm.errors import InputError, Remedy
from ecm.io.arrays import F, I
from ecm.io.events import Progress
from ecm.io.settings import Checked
from ecm.io.table import Table
from ecm.models.layout import Layout, anything
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import Noise

Weights = Literal["auto", "noise", "spread"]
"""How rows and components count in a fit (`fit_model`)."""


@dataclass(frozen=True)
class FittedMap:
    """A map fitted to measured rows, and how uncertain its coefficients are."""

    base: StiffnessMap
    noise: Noise
    covariance: F | None = None
    """(k, k) covariance of the coefficients; None where it is not known."""
    residual_variance: float | None = None
    """Whitened residual square per degree of freedom; None where the noise was not used."""


@dataclass(frozen=True)
class ModelSpecification(Checked, ABC):
    """The kind of model to fit; each subclass is one family of models.

    A subclass states its `kind` and how to fit and read its map; one line in `registry.py` makes it
    known to `fit_model`, to the command line and to model files.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("poly:3").alias
    'cubic'
    """

    kind: ClassVar[str]
    """Kind of map in a model file; also the short name, unless the subclass has another."""
    usage: ClassVar[str] = ""
    """How short names are written, for messages; empty where the kind is the only one."""
    weighted: ClassVar[bool] = False
    """Whether `weights` may be chosen."""
    any_columns: ClassVar[bool] = False
    """Whether it fits any pose columns; else it needs all six."""
    takes_inputs: ClassVar[bool] = False
    """Whether it takes the inputs of actuators behind six pose columns."""

    @property
    def name(self) -> str:
        """Short name, as on the command line."""
        return self.kind

    @property
    def most_rows(self) -> int | None:
        """Largest number of rows that are fitted: of more, some that are spread over all."""
        return None

    @property
    def alias(self) -> str:
        """The short name that people use: `cubic` for `poly:3`."""
        return self.name

    @property
    def title(self) -> str:
        """The alias with all else that was chosen, as options of the command line."""
        return self.alias

    @classmethod
    def from_name(cls, name: str) -> ModelSpecification | None:
        """Return the specification with this short name; None where it is of another family."""
        return cls() if name == cls.kind else None

    @abstractmethod
    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Fit the map to a table that holds measured rows only; `progress` is told the share."""

    def maps_without(
        self,
        table: Table,
        fold: I,
        fitted: StiffnessMap | None,
        progress: Progress | None = None,
    ) -> list[StiffnessMap] | None:
        """Maps fitted without each fold of many rows, at the cost of one fit; None by default.

        Parameters
        ----------
        table
            N measured rows.
        fold
            (N,) number of each row's fold, from 0.
        fitted
            Map that was fitted to all rows, if there is one.
        progress
            Called with the rows that are read, of all.
        """
        return None

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the family's own keys in a model file of n pose and m wrench columns.

        Polynomials and energies have none here: the reader in Rust checks theirs.
        """
        return anything

    @staticmethod
    @abstractmethod
    def map_from_document(document: dict[str, Any]) -> StiffnessMap:
        """Return the map of an opened model file."""


CHOOSE = Remedy("let held-out rows choose the model", "ecm fit DATA --model choose --out OUT")
"""The way out where a model does not fit the rows or the columns of a table."""


def length_of(table: Table, name: str) -> float:
    """Length of the mechanism, m; InputError where the table does not state it."""
    if table.meta.length_m is None:
        raise InputError(
            f"{table.source}: {name} needs the mechanism's length; "
            "give [mechanism] length_m in the data's TOML",
            remedy=CHOOSE,
        )
    return float(table.meta.length_m)


def pose_and_wrench_columns(table: Table) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Pose columns with those of actuators, and wrench columns; InputError where one is none."""
    inputs, outputs = (*table.pose_columns, *table.actuation_columns), table.wrench_columns
    if not inputs or not outputs:
        lacking = "pose" if not inputs else "wrench"
        raise InputError(f"{table.source}: a fit needs at least one {lacking} column, found none")
    return inputs, outputs
