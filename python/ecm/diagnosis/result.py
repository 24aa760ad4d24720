"""The result of a diagnosis: it prints, plots, and becomes a report or a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.diagnosis.accept import AcceptanceCheck
from ecm.diagnosis.check import NotTestable
from ecm.diagnosis.classify import Headline
from ecm.diagnosis.family import Family
from ecm.diagnosis.gate import Gate, Leftover
from ecm.diagnosis.given_model import GivenModel
from ecm.diagnosis.identifiability import DetectionLimit
from ecm.diagnosis.next_experiment import Proposal
from ecm.diagnosis.search import Refinement
from ecm.diagnosis.sections import diagnosis_report
from ecm.diagnosis.stated_numbers import NoiseFinding
from ecm.diagnosis.summary import Summary, fields_json, to_json
from ecm.diagnosis.unexplained import Unknown
from ecm.effects import Effect
from ecm.errors import EcmError, Remedy, remedy_of
from ecm.io.extras import require
from ecm.models.joint_fit import FittedEffect
from ecm.models.refit import refit, refuse_addition
from ecm.regression.folds import RowsUsed
from ecm.regression.noise import Noise
from ecm.report import figures as draw
from ecm.report.blocks import Block
from ecm.report.page import Report, Shown

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model


@dataclass(frozen=True)
class Addition:
    """What the named effects bring to the model that was given.

    Examples
    --------
    >>> found = Addition(("payload",), 1.48, 1.18, "", Remedy("add it", "ecm refit MODEL DATA"))
    >>> found.to_dict()["held_out"]
    {'before': 1.48, 'after': 1.18}
    """

    effects: tuple[str, ...]
    before: float | None
    """Held-out error over the noise of the model fitted to these rows; None where not known."""
    after: float | None
    """The same with the effects."""
    refused: str
    """Why `ecm refit` would refuse; empty where it adds them."""
    remedy: Remedy | None
    """The command that adds them: to this model, else to one that holds them."""

    def to_dict(self) -> dict[str, Any]:
        """For the report: plain values."""
        return {
            "effects": list(self.effects),
            "held_out": {"before": self.before, "after": self.after},
            "refused": self.refused,
            "remedy": None if self.remedy is None else self.remedy.to_dict(),
        }


def addition_to(model: Model, table: Table, effects: Sequence[Effect]) -> Addition | None:
    """Add effects to a model as `ecm refit` does; None where it has them all already."""
    present = {item.id for item in model.effects}
    new = [effect for effect in effects if effect.id not in present]
    if not new:
        return None
    ids = tuple(effect.id for effect in new)
    try:
        found = refit(model, table, add=new)
        refuse_addition(found, table, model)
    except (EcmError, np.linalg.LinAlgError) as error:
        said = getattr(error, "message", str(error))
        return Addition(ids, None, None, said, remedy_of(error))
    before, after = (record.held_out for record in found.history[-2:])
    known = not found.noise.is_residual
    options = " ".join(f"--add {id}" for id in ids)
    command = Remedy(f"add {' and '.join(ids)}", f"ecm refit MODEL DATA {options} --out OUT")
    return Addition(ids, before if known else None, after if known else None, "", command)


@dataclass(frozen=True)
class BaseSummary:
    """The base that effects are named against."""

    kind: str
    """physics, energy or polynomial."""
    error_over_noise: float
    """Whitened rms of its own error."""
    mesh_error: dict[str, float] | None = field(default=None, metadata={"optional": True})
    """Share of each wrench component by which the standard mesh differs from the fine one, by
    column; None where there is no second mesh to compare with."""
    mesh_error_over_noise: float | None = field(default=None, metadata={"optional": True})
    """Whitened rms of what that makes at the rows, beside what E and nu take in."""


@dataclass(frozen=True)
class NoiseSummary:
    """Noise of the rows, and the effects of the noise."""

    figures: Noise
    effects: tuple[NoiseFinding, ...]
    """Effects of the noise that are seen."""
    tested: tuple[str, ...]
    """Ids of all that were tested."""

    @property
    def source(self) -> str:
        """repeats, declared or assumed."""
        return self.figures.source

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        effects = {"effects": to_json(self.effects), "tested": list(self.tested)}
        own = {"is_residual": True} if self.figures.is_residual else {}
        own["is_assumed"] = self.figures.is_assumed
        return self.figures.to_dict() | own | effects


@dataclass(frozen=True)
class RankedEffect:
    """One line of the ranking; the size is that of the best determined parameter."""

    id: str
    p: float
    delta_bic: float
    parameter: str
    size: float
    sd: float
    unit: str
    expected_fall: float
    """Expected fall of the error, in noise units."""


@dataclass(frozen=True)
class ComponentErrors:
    """Root mean square error of each component, in the unit of its column."""

    before: dict[str, float]
    """Errors of the model as given, not refitted."""
    after: dict[str, float]
    """Errors of the base that names are against with the accepted effects."""
    floor: dict[str, float]
    """Errors by noise alone; empty where nothing is known of the noise."""
    ceiling: dict[str, float]
    """Held-out errors of the base with a free cubic of the pose; empty without full poses."""


@dataclass(frozen=True)
class RunError:
    """Held-out error of one run of a continuous test."""

    run: int
    before: float
    after: float


@dataclass(frozen=True)
class HeldOut:
    """Whitened root mean square of the base on held-out rows, without and with the effects."""

    before: float
    after: float
    ceiling: float | None = field(default=None, metadata={"optional": True})
    by_run: tuple[RunError, ...] = field(default=(), metadata={"optional": True})
    """Errors of a continuous test, run by run."""


@dataclass(frozen=True)
class OutsideCause:
    """What is not in the catalogue and would have got the same name."""

    id: str
    """The effect that it looks like."""
    what: str
    apart: str
    """What would tell it apart."""


@dataclass(frozen=True)
class Diagnosis(Shown):
    """What is missing, what this rests on, and what cannot be told.

    `print` shows three lines, `report` the rest in words and tables, `plot` draws the ranking,
    `to_pandas` gives it as a table, and `to_dict` is plain JSON. Rows are counted from 0 here and
    from 1 in the report.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 0.01 * np.cos(40 * np.arange(12))})
    >>> result = ecm.diagnose(ecm.fit_model(table, "linear"), table, effects=[])
    >>> result.verdict, result.base.kind, result.noise.source
    ('none', 'polynomial', 'assumed')
    """

    seed: int
    model: GivenModel
    """The model that was given: how it fits these rows as it stands, and what is wrong with it."""
    base: BaseSummary
    noise: NoiseSummary
    gate: Gate
    verdict: Headline
    probability: float
    """That the verdict is right, calibrated on the benchmarks; see `ecm.diagnosis.probability`."""
    effects: tuple[FittedEffect, ...]
    """The accepted effects, fitted jointly; of a class its best member."""
    answer: tuple[tuple[str, ...], ...]
    """One tuple per missing effect: one id when named, the class when ambiguous."""
    ranking: tuple[RankedEffect, ...]
    checks: tuple[AcceptanceCheck, ...]
    confusable: tuple[tuple[str, str], ...]
    """Pairs that these data cannot tell apart."""
    not_testable: tuple[NotTestable, ...]
    detection_limits: dict[str, DetectionLimit]
    unknown: Unknown | None
    family: Family | None = field(metadata={"optional": True})
    """What drives the missing effect, where its form is not known."""
    rmse: ComponentErrors
    held_out: HeldOut
    signature: dict[str, float]
    """Share of the residual by the look of it: proportional to the wrench, even, ..."""
    next_experiment: tuple[Proposal, ...]
    outliers: tuple[int, ...]
    """Rows of the table whose robust weight is below one half."""
    rows_used: RowsUsed | None = field(metadata={"optional": True})
    """Which rows of a large table were used; None where all were."""
    upper_bound: float
    """95 % bound on the strength of what smooth functions could still hide."""
    left_over: Leftover
    """What is left after the accepted effects."""
    look_alikes: tuple[OutsideCause, ...]
    """Causes outside the catalogue for each effect of the answer."""
    directions: dict[str, str] | None = field(metadata={"optional": True})
    """Whether the stiffness grows or falls, by effect; None where no id leaves that open."""
    refinements: tuple[Refinement, ...] = field(metadata={"json": "further"})
    """Richer forms of the accepted effects that were tried."""
    warnings: tuple[str, ...]
    addition: Addition | None = field(default=None, metadata={"optional": True})
    """What the effects bring to the model that was given; None where none is named."""

    def __str__(self) -> str:
        return str(self.summary())

    def blocks(self) -> list[Block]:
        """Return the three lines as a table."""
        return [*self.report().sections[0].blocks]

    def report(self) -> Report:
        """Return what terminal, notebook and page show: `print(result.report().text())`."""
        return diagnosis_report(self.to_dict())

    def summary(self) -> Summary:
        """Return what is missing, how to add it, and what to do next: a line each."""
        return Summary.of(self._document())

    def sentence(self) -> str:
        """Return what is wrong with the model that was given, and the verdict, in plain words."""
        return f"{self.model.sentence()} {self._headline()}{self._source_of_noise()}"

    def _source_of_noise(self) -> str:
        if self.noise.figures.is_residual:
            return " Nothing is known of the noise: give repeats or [instrument] figures."
        return {
            "repeats": "",
            "declared": " The noise is as declared, not measured.",
            "assumed": " The noise is assumed: give repeats or [instrument] figures.",
        }.get(self.noise.source, "")

    def _headline(self) -> str:
        if self.verdict == "none":
            bounded = math.isfinite(self.upper_bound)
            bound = f"s < {self.upper_bound:.2f}" if bounded else "too few rows to bound s"
            return f"Nothing is missing that these data could show ({bound})."
        if self.family is not None:
            words = f": {self.unknown.words}" if self.unknown and self.unknown.words else ""
            return f"Something is missing that follows {self.family}{words}."
        if self.verdict == "unknown":
            nearest = self.unknown.nearest if self.unknown else None
            near = f"; nearest is {nearest.id} ({nearest.share:.0%})" if nearest else ""
            words = self.unknown.words if self.unknown else ""
            if self.unknown is not None and self.unknown.misread:
                return self._misread(self.unknown)
            if self.unknown is not None and self.unknown.slow_noise is not None:
                apart = "a pause, or the same motion again or at another speed, would"
                return f"What is left is {words}; {apart}."
            listed = ", ".join(item.id for item in self.effects)
            already = f" beside {listed}, which is a part of it," if listed else ""
            return f"Something is missing{already} that no known effect explains: {words}{near}."
        outside = {one.id: one.what.split(":")[0] for one in self.look_alikes}
        directions = self.directions or {}

        def name(id: str, single: bool) -> str:
            said = [directions[id]] if id in directions else []
            said += [f"or {outside[id]}"] if single and id in outside else []
            return f"{id} ({'; '.join(said)})" if said else id

        names = " and ".join(
            " or ".join(name(id, len(members) == 1) for id in members) for members in self.answer
        )
        return f"Missing: {names}; {self._fall()}."

    def _misread(self, unknown: Unknown) -> str:
        if self.model.statement is not None:  # said of the model already
            return "Mend that first: a base that is fitted to these rows takes it in."
        read = unknown.statement is not None
        first = "The table looks misread" if read else "Something is stated wrongly"
        return f"{first}: {unknown.words}."

    def _fall(self) -> str:
        before, after = self.held_out.before, self.held_out.after
        if self.noise.figures.is_assumed:
            return f"the base's held-out error falls to {after / max(before, 1e-300):.0%}"
        return f"the base's held-out error {before:.2f} -> {after:.2f} times the noise"

    def to_pandas(self) -> Any:
        """Return the ranking as a DataFrame; needs pandas.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        pandas = require("pandas", "data", "The ranking as a DataFrame")
        return pandas.DataFrame(to_json(self.ranking))

    def plot(self, most: int = 12) -> Any:
        """Return a plotly figure of the fall of BIC that each effect would bring alone.

        Parameters
        ----------
        most
            Number of effects that are shown, the best first.

        Raises
        ------
        MissingExtra
            If plotly is not installed.
        """
        shown = self.ranking[:most][::-1]
        falls, names = [one.delta_bic for one in shown], [one.id for one in shown]
        layout = draw.plain_layout("fall of BIC", "", title={"text": self._headline()})
        bars = {"type": "bar", "orientation": "h", "x": falls, "y": names}
        return draw.plotly_figure({"data": [bars], "layout": layout})

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON report (docs/schemas/diagnose.json)."""
        document = self._document()
        return document | {"summary": asdict(Summary.of(document))}

    def _document(self) -> dict[str, Any]:
        """The report without its summary."""
        partial = [item.id for item in self.effects] if self.unknown else []
        document = {"schema": 1, "seed": self.seed, "sentence": self.sentence()}
        return (
            document
            | fields_json(self)
            | {"partial": partial}
            | {"outliers": [row + 1 for row in self.outliers]}
        )
