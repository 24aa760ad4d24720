"""A plan of the poses worth measuring, with what it can show, its figures and its page."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ecm.designs import (
    Design,
    DesignSettings,
    NominalModel,
    Size,
    design_sizes,
    diagnosable_plan,
    nominal_model,
    offsets_from_free,
    optimal_design,
    paper_plan,
    plain_plan,
    rig_noise,
)
from ecm.designs.plans import predicted_table
from ecm.diagnosis.accept import confusable_pairs
from ecm.diagnosis.next_experiment import detection_limits
from ecm.diagnosis.problem import assemble
from ecm.effects import Effect, Rows, all_effects
from ecm.effects.registry import effects_of_actuators
from ecm.errors import InputError
from ecm.io.arguments import check_arguments, check_type
from ecm.io.columns import POSE, WRENCH, behind
from ecm.io.events import to_json
from ecm.io.table import Table
from ecm.models import Model
from ecm.models.actuated import ActuatedMap
from ecm.report import figures as draw
from ecm.report.blocks import (
    Block,
    Cell,
    FigureBlock,
    Report,
    Section,
    Shown,
    TableBlock,
    TextBlock,
    number,
)
from ecm.rig import RigSettings, campaign_minutes
from ecm.workflow.config import Console, Silent


@dataclass(frozen=True)
class Identifiability:
    """What a plan can tell about one effect."""

    id: str
    parameter: str = ""
    size: float = np.inf
    """Size of the effect's best visible parameter that is named with chance 0.9."""
    unit: str = ""
    rivals: tuple[str, ...] = ()
    """Effects of the list that this plan cannot separate from it."""
    reason: str = ""
    """Why it cannot be seen at all."""
    record: str = ""
    """What to record so that it can be seen."""

    @property
    def named(self) -> bool:
        """Whether it can be seen and separated from every other of the list."""
        return not self.reason and not self.rivals

    def sentence(self) -> str:
        """Return one plain line."""
        if self.reason:
            return f"{self.id}: not visible, {self.reason} (record: {self.record})"
        size = f"from {self.size:.2g}{behind(self.unit)} of {self.parameter}"
        if self.rivals:
            return f"{self.id}: seen {size}, but not told from {', '.join(self.rivals)}"
        return f"{self.id}: named {size}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        seen = ("id", "parameter", "size", "unit", "rivals")
        names = ("id", "reason", "record") if self.reason else seen
        return {name: to_json(getattr(self, name)) for name in names}


def _a_little_noisy(table: Table, base: NominalModel) -> Table:
    """Return the table with a hundredth of the noise, so that no row is exact."""
    covariance = base.noise.covariance(Rows(table, base.base))
    names = base.base.outputs
    random = np.random.default_rng(0).standard_normal((len(table), len(names), 1))
    noisy = table.matrix(names) + 0.01 * (np.linalg.cholesky(covariance) @ random)[:, :, 0]
    return table.with_columns(dict(zip(names, noisy.T, strict=True)))


def identifiability(
    plan: Table, base: NominalModel, effects: Sequence[Effect], *, rig: RigSettings | None = None
) -> list[Identifiability]:
    """Return what a plan can show about each effect, those that it can name first.

    The Fisher information of base and effects gives the smallest size that the diagnosis would name
    with chance 0.9.

    Parameters
    ----------
    plan
        Table of poses with the columns of a plan.
    base
        Nominal model: base, noise and description.
    effects
        Effects to look for.
    rig
        Settings of the rig; default: those of a new rig.
    """
    table = predicted_table(plan, base, rig)
    problem = assemble(base.base, _a_little_noisy(table, base), effects, base.noise)
    # There is no residual here; the noise is the declared one.
    problem = replace(problem, scale=1.0)
    limits = detection_limits(problem)
    pairs = confusable_pairs(problem)
    results = []
    for effect in effects:
        if effect.id in limits:
            alike = tuple(b if a == effect.id else a for a, b in pairs if effect.id in (a, b))
            results.append(Identifiability(effect.id, **vars(limits[effect.id]), rivals=alike))
            continue
        reason, record = "the base absorbs it", "[mechanism]"
        missing = problem.untestable.get(effect.id)
        if missing is not None:
            reason, record = missing.reason, missing.record
        elif effect.kind == "noise":
            reason, record = "it changes the scatter, not the mean", "repeats"
        results.append(Identifiability(effect.id, reason=reason, record=record))
    return sorted(results, key=lambda item: (bool(item.reason), bool(item.rivals)))


def pose_figure(candidates: Table, design: Design, x: str, y: str) -> dict[str, Any]:
    """Two coordinates of the candidates, the chosen ones marked."""
    series = (
        ("candidates", np.arange(len(candidates)), "#c4ccd6", 4, "circle"),
        ("chosen", design.indices, draw.COLOURS[0], 7, "diamond"),
    )
    data = [
        draw.scatter(
            candidates.column(x)[rows],
            candidates.column(y)[rows],
            name=name,
            marker={"color": colour, "size": size, "symbol": symbol},
        )
        for name, rows, colour, size, symbol in series
    ]
    return {"data": data, "layout": draw.plain_layout(x, y)}


def size_figure(sizes: Sequence[Size], knee: Size) -> dict[str, Any]:
    """Expected errors over n, the knee marked."""
    n = [float(size.n) for size in sizes]
    figure = draw.lines(
        {
            "wrench h": (n, [size.wrench_error for size in sizes]),
            "stiffness K, times half the range": (n, [size.stiffness_error for size in sizes]),
        },
        x_title="poses n",
        y_title="expected error / noise of a reading",
        log_x=True,
        log_y=True,
    )
    marker = {"symbol": "circle-open", "size": 18, "color": "#b3261e"}
    errors = [knee.wrench_error, knee.stiffness_error]
    figure["data"].append(
        draw.scatter([float(knee.n)] * 2, errors, name=f"knee, n = {knee.n}", marker=marker)
    )
    return figure


def _poses(planned: PlannedDesign) -> list[Block]:
    """The design in numbers, and among all candidates, two coordinates a figure."""
    candidates, design = planned.candidates, planned.design
    rows: list[list[Cell]] = [
        ["poses", len(design.indices)],
        ["candidates", len(candidates)],
        [design.criterion, number(design.value, 6)],
        ["certified bound", number(design.bound, 6)],
        ["share of what is possible", f"{100.0 * design.efficiency:.2f} %"],
    ]
    if planned.minutes is not None:
        rows.append(["minutes on the rig", round(planned.minutes)])
    names = candidates.pose_columns
    return [
        TableBlock("The design; no other of its size can pass the bound.", ("", ""), rows),
        *(
            FigureBlock(
                f"Chosen poses among the candidates, {x} and {y}.",
                pose_figure(candidates, design, x, y),
            )
            for x, y in zip(names[0:-1:2], names[1::2], strict=False)
        ),
    ]


def _sizes(sizes: Sequence[Size]) -> list[Block]:
    knee = next(size for size in sizes if size.knee)
    rows = [
        [size.n, size.wrench_error, size.stiffness_error, f"{100.0 * size.efficiency:.1f} %",
         "<- knee" if size.knee else ""]
        for size in sizes
    ]  # fmt: skip
    return [
        TextBlock(f"Beyond {knee.n} poses each further one improves the model less.", strong=True),
        FigureBlock(
            "Expected error from noise alone over the number of poses.", size_figure(sizes, knee)
        ),
        TableBlock(
            "In units of one reading's noise; the error of the model itself does not fall.",
            ("n", "h", "K", "of what is possible", ""),
            rows,
        ),
    ]


Preset = Literal["paper", "diagnosable"]
_PLANS = {"paper": paper_plan, "diagnosable": diagnosable_plan, None: plain_plan}


@dataclass(frozen=True, repr=False)
class PlannedDesign(Shown):
    """A design as a plan, with what is known about it before anything is measured.

    Examples
    --------
    >>> import numpy as np, ecm
    >>> poses = ecm.as_table({"y_m": np.linspace(-0.01, 0.01, 21)})
    >>> planned = ecm.design(poses, 4, model="linear")
    >>> planned.to_dict()["rows"]
    [1, 2, 20, 21]
    >>> print(planned)
    4 poses, D-efficiency 100.0 % of what is possible
    """

    candidates: Table
    """The poses to choose from."""
    plan: Table
    """The rows in visiting order."""
    design: Design
    """The chosen candidates and how good they are."""
    model: str | None
    """Model that the design is for; None where only distances count."""
    seed: int
    reproducible: bool
    """False with a time limit."""
    minutes: float | None
    """Minutes on the rig; None where no length is known."""
    effects: tuple[Identifiability, ...] = ()
    """What a diagnosable plan can name, and from what size."""
    sizes: tuple[Size, ...] = ()
    """Expected error against the number of poses, where it was asked for."""

    def blocks(self) -> list[Block]:
        """Return how good the design is, and the effects that it can show."""
        blocks: list[Block] = [TextBlock(self.design.sentence(), strong=True)]
        if not self.reproducible:
            blocks.append(TextBlock("With a time limit another run may give another design."))
        if self.effects:
            caption = "The size that the plan sees with chance 0.9, before anything is measured."
            blocks.append(TableBlock(caption, ("",), [[one.sentence()] for one in self.effects]))
        return blocks

    def report(self) -> Report:
        """Return the chosen poses among the candidates, effects, and n against expected error."""
        sections = [Section("Poses to measure", self.blocks())]
        if self.sizes:
            sections.append(Section("How many", _sizes(self.sizes)))
        sections.append(Section("The design", _poses(self)))
        return Report("Poses to measure", self.design.sentence(), sections)

    def to_pandas(self) -> Any:
        """Return the plan as a pandas DataFrame, in visiting order."""
        return self.plan.to_pandas()

    def plot(self, x: str | None = None, y: str | None = None) -> Any:
        """Return a plotly figure of the chosen poses among the candidates.

        Parameters
        ----------
        x, y
            Names of two pose columns; default: the first two.

        Raises
        ------
        MissingExtra
            If plotly is not installed.
        """
        first, second = (*self.candidates.pose_columns, *self.candidates.pose_columns)[:2]
        return draw.plotly_figure(
            pose_figure(self.candidates, self.design, x or first, y or second)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document of `ecm design`."""
        return {
            "schema": 1,
            "seed": self.seed,
            "criterion": self.design.criterion,
            "model": self.model,
            "n": len(self.design.indices),
            "rows": (self.design.indices + 1).tolist(),
            **{
                key: getattr(self.design, key) for key in ("value", "bound", "efficiency", "status")
            },
            "reproducible": self.reproducible,
            "minutes": self.minutes,
            "effects": [item.to_dict() for item in self.effects],
            "how_many": [size.to_dict() for size in self.sizes],
        }


def design(
    candidates: Table,
    n: int,
    *,
    preset: Preset | None = None,
    base: Model | None = None,
    rig: RigSettings | None = None,
    effects: Sequence[Effect] = (),
    how_many: bool = False,
    console: Console | None = None,
    **search: Any,
) -> PlannedDesign:
    """Choose the n poses of a table that are worth measuring, and plan their visits.

    Parameters
    ----------
    candidates
        Table of N poses.
    n
        Number of poses to choose.
    preset
        Protocol of the plan: `paper`, `diagnosable` (repeats, both approaches, several dwells), or
        None for the chosen rows alone.
    base
        Nominal model: rows are weighed by their noise at its stiffness.
    rig
        Instruments and times of the rig; the default rig where none is given.
    effects
        Effects to be told apart; needs the preset `diagnosable`, whose default is all of them.
    how_many
        Also compute the expected error for every smaller number of poses.
    console
        Where progress is printed.
    search
        Fields of `DesignSettings` (criterion, model, seed, threads, starts, ...), and `include`,
        `exclude` and `measured` of `optimal_design`.

    Returns
    -------
    PlannedDesign
        Plan, design, and what is known of them.

    Raises
    ------
    InputError
        Effects without the preset, or a table or options that cannot give a design.

    Examples
    --------
    >>> import numpy as np, ecm
    >>> x = np.linspace(-0.01, 0.01, 21)
    >>> planned = ecm.design(ecm.as_table({"y_m": x, "z_m": x**2 / 0.01}), 4, model="linear")
    >>> len(planned.plan), planned.design.efficiency > 0.9
    (4, True)
    """
    check_arguments(design, locals())
    if effects and preset != "diagnosable":
        raise InputError(
            "--effects: needs --preset diagnosable, whose protocol tells effects apart; add it"
        )
    driven, six = candidates.actuation_columns, candidates.pose_columns == POSE
    if preset == "diagnosable" and not six:
        raise InputError(
            f"{candidates.source}: --preset diagnosable goes from home and from the other side: it "
            f"needs all six pose columns, found {', '.join(candidates.pose_columns) or 'none'}; "
            "--preset paper takes any"
        )
    console = console or Silent()
    # Free polynomials absorb the effects.
    check_type("model", search.get("model"), str | None)
    usual = "actuated4" if driven and six else "energy4" if effects else "cubic"
    model = search.pop("model", None) or usual
    threads, seed = search.get("threads", 0), search.get("seed", 0)
    weighted = base is not None or rig is not None or model == "physics" or bool(effects)
    nominal = None
    if weighted:
        physics = model == "physics"
        nominal = nominal_model(
            candidates,
            base,
            physics=physics,
            noise=None if rig is None else rig_noise(rig),
            threads=threads,
            progress=console.progress("physics base") if physics else None,
        )
    elif six and (preset == "diagnosable" or driven):
        nominal = _free_nominal(candidates, threads, console)
    names = (*candidates.pose_columns, *driven)
    poses = candidates.matrix(names)
    rows = {key: search.pop(key) for key in ("include", "exclude", "measured") if key in search}
    settings = DesignSettings(
        model=model,
        length_m=candidates.meta.length_m,
        effects=tuple(effects),
        columns=names,
        **search,
    )
    weights = nominal if weighted else None
    progress = console.progress("design")
    chosen = optimal_design(poses, n, settings, base=weights, progress=progress, **rows)
    plan = _PLANS[preset](candidates, chosen, seed=seed)
    if nominal is not None and isinstance(nominal.base, ActuatedMap):
        plan = offsets_from_free(plan, nominal.base)
    testable: list[Identifiability] = []
    if preset == "diagnosable" and nominal is not None:
        listed = (*all_effects(), *(effects_of_actuators() if driven else ()))
        testable = identifiability(plan, nominal, effects or listed, rig=rig)
    sizes: list[Size] = []
    if how_many:
        smaller = DesignSettings(
            criterion="d" if settings.criterion == "maximin" else settings.criterion,
            model=model,
            length_m=settings.length_m,
            columns=names,
            iterations=60,
            seed=seed,
            threads=threads,
        )
        progress = console.progress("how many")
        sizes = design_sizes(poses, (), smaller, most=n, base=weights, progress=progress)
    return PlannedDesign(
        candidates=candidates,
        plan=plan,
        design=chosen,
        model=None if chosen.criterion == "maximin" else model,
        seed=seed,
        reproducible=settings.time_limit_s == 0.0,
        minutes=_minutes(plan, rig),
        effects=tuple(testable),
        sizes=tuple(sizes),
    )


def _free_nominal(table: Table, threads: int, console: Console) -> NominalModel | None:
    """The nominal model where it costs no option: measured wrenches or a body are there."""
    with suppress(InputError):
        if table.wrench_columns == WRENCH or table.meta.body() is not None:
            return nominal_model(table, threads=threads)
    console.print(
        "which effects this plan can name is not known without a nominal stiffness; give --base "
        "MODEL, or a [mechanism] beside the candidates"
    )
    return None


def _minutes(plan: Table, rig: RigSettings | None) -> float | None:
    """Minutes on this rig, or on the default one; None where no length is known."""
    if plan.meta.length_m is None or plan.pose_columns != POSE:
        return None
    return campaign_minutes(plan, rig or RigSettings())
