"""Write docs/effects/: a page for each family of effects, from the classes of the catalogue.

    python docs/effects_pages.py               # the pages
    python docs/effects_pages.py --pictures    # and a picture of each family

A class gives its sentence of physics, its formula (the docstring, with what its parameters mean),
forms (the fields), parameters, columns and look-alikes. Words that stand here are those that all
effects share.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import ecm
from ecm._native import rotation_matrices
from ecm.effects import Effect, Parameter, all_effects, effects_for
from ecm.effects.experiments import get_experiment
from ecm.effects.noise import NoiseEffect
from ecm.effects.protocol import correction_of
from ecm.effects.registry import _GROUPS as GROUPS
from ecm.effects.registry import effects_of_actuators
from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.io.columns import JOINTS, POSE, WRENCH
from ecm.io.settings import meanings
from ecm.io.table import Table
from ecm.logs import import_log
from ecm.regression.rows import Rows, actuators_of
from ecm.rig import RigSettings
from ecm.rig.arm.simulation import inverse_kinematics, scene, swivel_angle

ROOT = Path(__file__).parents[1]
FOLDER = Path(__file__).with_name("effects")
NECK = ROOT / "examples" / "neck_measured.csv"
HINGE = ROOT / "examples" / "hinge_log.csv"
ARM = ROOT / "examples" / "wound_arm_pairs.csv"
FEW = (POSE[5], WRENCH[5])
MADE = {"mechanism": {"length_m": 0.1}}
TWELVE = "the twelve columns of pose and wrench"
SOURCE, PARAMETERS = "Source: ", "Parameters: "
LISTS = ("EFFECTS", "FEW", "ACTUATED", "ACTUATED_FEW")
SYMBOLS = """
## Symbols

h is the wrench of the model at the pose p = (x, y, z, θ), both in base axes; K = ∂h/∂p its
stiffness, K_s the same per small motion in base axes ([the mechanics](../explain/mechanics.md));
p0 the pose at rest. R turns top axes to base axes, B does so with force and moment, A moves them
from the sensor to the top frame. J is the Jacobian of a robot's joints q, G = ∂h/∂a that of an
actuator's input a. c and θ are coordinates of the mid frame, c_t and θ_t their parts across the
axis, V and U energies, L the length, E, G, ν the moduli, W a strain energy. A dash ' after a matrix
transposes it, after a coordinate it is a rate; x is the cross product. A formula is what the effect
adds to h, or what becomes of h where h stands in it.
"""
BY_COLUMNS = (
    "It has parameters for each column of the table that takes part, in the units of these columns"
)
OWN = "The catalogue's own formula ([what that means](index.md))."
UNITS = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "°"), "1": (100.0, "%"), "Pa": (1e-3, "kPa")}
"""Units in which a person says a size."""


def page_of(group: str) -> str:
    """The text of a family's page."""
    module, effects = family(group)
    title = sentence(module)
    lines = [f"# {title}\n", written()]
    shown: dict[str, list[str]] = {}
    for effect in effects:
        if place := drawn(effect):
            shown.setdefault(place.where, []).append(f"`{effect.id}`")
    if shown:
        made_up = " What follows *with* is made up." if any("*with*" in w for w in shown) else ""
        where = "; ".join(
            f"{', '.join(names)} on the rows of {path}" for path, names in shown.items()
        )
        lines.append(
            f"![What each effect leaves in the residual, at its ordinary size]({group}.png)\n\n"
            "What an effect at its ordinary size leaves in the residual of a model without it, in "
            f"the component that it changes most: {where}.{made_up}\n"
        )
    for effect in effects:
        lines += section(group, effect)
    lines.append(SYMBOLS)
    return "\n".join(lines)


def index() -> str:
    """The text of the page that lists all effects."""
    lines = [
        "# Effects\n",
        written(),
        "What `ecm diagnose` can name. Each family has a page: the formula of each effect, a "
        "picture of what it leaves, the columns that show it, and what looks like it. `ecm effects "
        "ID` prints one in the terminal. What is not here, you [add yourself](../own_effect.md). "
        "Where no literature is named, the formula is the catalogue's own, from statics, geometry "
        "or the way an instrument reads.\n",
        "| effect | what it is | what the table must have | family |",
        "|---|---|---|---|",
    ]
    for group in GROUPS:
        module, effects = family(group)
        for effect in effects:
            any_table = TWELVE if full_only(effect) else "a pose and a wrench column"
            row = (
                f"[`{effect.id}`]({group}.md#{effect.id})", safe(first(effect.physics)),
                safe(effect.needs or any_table), f"[{sentence(module)}]({group}.md)",
            )  # fmt: skip
            lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n"


def section(group: str, effect: Effect) -> Iterator[str]:
    """One effect in full."""
    yield f"## {effect.id}\n"
    yield f"{safe(effect.physics)}\n"
    formula, *more = paragraphs(effect)
    papers = [text(part).removeprefix(SOURCE) for part in more if part.startswith(SOURCE)]
    more = [part for part in more if not part.startswith((SOURCE, PARAMETERS))]
    yield f"**Formula.** {text(formula)}\n"
    yield from (f"{text(part)}\n" for part in more)
    forms = meanings(type(effect)) if hasattr(effect, "__dataclass_fields__") else {}
    shown = {
        name: what
        for name, what in forms.items()
        if what and name in type(effect).__dataclass_fields__
    }
    if shown:
        yield "Its forms differ in\n"
        yield from (f"- `{name}`: {text(what)}" for name, what in shown.items())
        yield ""
    parameters, there = effect.parameters, ""
    if not parameters and (place := drawn(effect)):
        parameters = place.form.variants(place.rows.table)[0].parameters
        there = f" (for the columns of {place.where})" if parameters else ""
    if parameters:
        yield f"**Parameters**{there}\n"
        yield from (f"- {line}" for line in sizes(effect, parameters))
        yield ""
    else:
        none = "It has no parameters" if effect.kind == "noise" else BY_COLUMNS
        yield f"**Parameters.** {none}.\n"
    needs = effect.needs or "nothing beside pose and wrench"
    few = along_few(effect)
    own = needs.rstrip(".")
    if few is not effect and few.id == effect.id and few.needs != effect.needs:
        own += f"; with fewer than the twelve columns: {few.needs or 'nothing more'}"
    elif not full_only(effect):
        own += "; any columns of pose and wrench"
    yield f"**Columns:** {safe(own)}.\n"
    if effect.signature:
        none = "" if drawn(effect) else " No picture: it leaves no curve."
        shows = safe(effect.signature[0].upper() + effect.signature[1:])
        yield f"**How it shows.** {shows}.{none}\n"
    looks = [
        f"{link(other)}: {safe(get_experiment(name).action)}"
        for other, name in effect.rivals.items()
    ]
    if effect.outside:
        outside = f"{safe(effect.outside.what)}: {safe(effect.outside.apart)}"
        looks.append(f"or {outside}" if looks else outside)
    if looks:
        yield "**Looks like**, and what tells them apart:\n"
        yield from (f"- {look}" for look in looks)
        yield ""
    file = Path(inspect.getsourcefile(type(effect)) or "").relative_to(ROOT)
    code = f"[`{type(effect).__name__}`](../../{file})"
    yield f"**Source.** {' '.join(papers) or OWN} Code: {code}.\n"


def family(group: str) -> tuple[ModuleType, list[Effect]]:
    """The module of a family, and its effects, each once."""
    module = import_module(f"ecm.effects.{group}")
    listed = (effect for name in LISTS for effect in getattr(module, name, ()))
    found: dict[str, Effect] = {}
    for effect in listed:
        found.setdefault(effect.id, effect)
    return module, list(found.values())


def along_few(effect: Effect) -> Effect:
    """The form of an effect along a table of two columns."""
    forms = (*effects_for(FEW), *effects_for((*FEW, "pressure_1_Pa")))
    return next((form for form in forms if form.id == effect.id), effect)


def full_only(effect: Effect) -> bool:
    """Whether an effect has a form along all twelve columns of pose and wrench."""
    return any(effect.id == one.id for one in (*all_effects(), *effects_of_actuators()))


def link(id: str) -> str:
    """A link to an effect."""
    for group in GROUPS:
        if any(effect.id == id for effect in family(group)[1]):
            return f"[`{id}`]({group}.md#{id})"
    return f"`{id}`"


def sizes(effect: Effect, parameters: tuple[Parameter, ...]) -> list[str]:
    """Meaning, ordinary size and bounds of parameters in words, alike ones together."""
    groups: dict[str, list[str]] = {}
    for one in parameters:
        ends = [size(end, one.unit) for end in (one.lower, one.upper) if np.isfinite(end)]
        bounds = ""
        if np.isfinite(one.lower) and np.isfinite(one.upper):
            bounds = f", from {ends[0]} to {ends[1]}"
        elif ends:
            bounds = f", at {'least' if np.isfinite(one.lower) else 'most'} {ends[0]}"
        words = f"{meaning(effect, one.name)}. Ordinarily about {size(one.scale, one.unit)}{bounds}"
        groups.setdefault(words, []).append(one.name)
    return [f"{some(names)}: {words}" for words, names in groups.items()]


def meaning(effect: Effect, name: str) -> str:
    """What a parameter is, by its effect's docstring; KeyError where that does not say."""
    said = " ".join(part for part in paragraphs(effect) if part.startswith(PARAMETERS))
    for one in " ".join(said.removeprefix(PARAMETERS).rstrip(".").split()).split("; "):
        names, _, words = one.partition(": ")
        if any(fnmatch(name, pattern) for pattern in names.split(", ")):
            return safe(words)
    raise KeyError(f"{effect.id}: its docstring does not say what {name} is")


def paragraphs(effect: Effect) -> list[str]:
    """Paragraphs of a class: the formula, what is said about it, parameters, source."""
    return (inspect.getdoc(type(effect)) or "").split("\n\n")


def some(names: list[str]) -> str:
    """Names as code; of many the first and the last."""
    shown = names if len(names) <= 8 else [names[0], names[-1]]
    many = f" ({len(names)})" if shown is not names else ""
    return (", " if not many else " ... ").join(f"`{name}`" for name in shown) + many


def size(value: float, unit: str) -> str:
    """A size as a person says it: 0.1 mm, 2 %, 0.057° per N m."""
    if value == 0.0:
        return "0"
    if unit == "1/m":  # of a force per torque: no share of anything
        return f"{value:.3g} per m"
    head, over, below = unit.partition("/")
    if below == "s" and abs(value) < 2e-4:
        value, below = 3600.0 * value, "hour"
    factor, name = UNITS.get(head, (1.0, head))
    number = f"{float(f'{value * factor:.3g}'):,.15g}"
    joined = f"{number}{name}" if name == "°" else f"{number} {name}"
    return joined + (f" per {below.strip('()')}" if over else "")


def text(part: str) -> str:
    """A paragraph of a docstring in one line."""
    return safe(" ".join(part.split()))


def safe(words: str) -> str:
    """Words without what Markdown would take for a mark."""
    return re.sub(r"([*|<>])", r"\\\1", words)


def first(words: str) -> str:
    """The first sentence."""
    return words.partition(". ")[0].rstrip(".")


def sentence(module: ModuleType) -> str:
    """The first line of a module's docstring, as a title."""
    return (module.__doc__ or "").partition("\n")[0].rstrip(".")


def written() -> str:
    """Where a page comes from."""
    return "<!-- Written by docs/effects_pages.py from the classes of the catalogue. -->\n"


@cache
def example(path: Path) -> Table:
    """The table of an example."""
    if path == HINGE:
        return import_log(HINGE, axis="z", meta=HINGE.with_suffix(".toml")).table
    return ecm.read_table(path)


@cache
def rows_of(path: Path, added: tuple[str, ...] = ()) -> Rows:
    """The rows of an example with what was added, under a base that was fitted to them."""
    table = example(path)
    for name in added:
        table = ADDED[name].to(table)
    if added and table.actuation_columns == example(path).actuation_columns:
        return Rows(table, rows_of(path).base)
    name = {HINGE: "cubic", ARM: "actuated4"}.get(path, "energy4")
    return Rows(table, ecm.fit(table, name).base)


def joints(table: Table) -> Table:
    """The arm's joints at the poses, by its inverse kinematics, the elbow now here, now there."""
    place = scene(RigSettings.from_dict({"rig": {"mode": "robot"}}), table.meta.length_m or 0.1)
    found = []
    axes = rotation_matrices(np.ascontiguousarray(table.poses[:, 3:]))
    turns = np.resize((-0.3, 0.0, 0.3), len(table))
    for pose, frame, turn in zip(table.poses, axes, turns, strict=True):
        elbow = swivel_angle(place.home_rad) + turn
        goal = place.flange_goal(pose[:3], frame)
        found.append(inverse_kinematics(*goal, elbow, place.home_rad, 0.035).joints_rad)
    return table.with_columns(dict(zip(JOINTS, np.array(found).T, strict=True)))


def stream(table: Table) -> Table:
    """Samples of the moves between its first poses: a second each, then half a second of rest."""
    way = np.linspace(0.0, 1.0, 20)
    way = np.append(way**2 * (3.0 - 2.0 * way), np.ones(10))
    stops = table.matrix((*POSE, *WRENCH))[np.flatnonzero(table["kind"] == "pose")[:12]]
    samples = (stops[:-1, None] + np.diff(stops, axis=0)[:, None] * way[:, None]).reshape(-1, 12)
    columns = dict(zip((*POSE, *WRENCH), samples.T, strict=True))
    meta = replace(table.meta, file=replace(table.meta.file, kind="continuous"))
    return ecm.as_table(columns | {"time_s": 0.05 * np.arange(len(samples))}).with_meta(meta)


def tensions(table: Table) -> Table:
    """Each chamber as a tendon, with the tension of its pressure on a square centimetre."""
    named = {name: name.replace("pressure", "tension") for name in table.actuation_columns}
    named = {name: new.replace("_Pa", "_N") for name, new in named.items()}
    columns = {new: 1e-4 * table.column(name) for name, new in named.items()}
    return ecm.as_table({n: table.column(n) for n in (*POSE, *WRENCH)} | columns, meta=MADE)


@dataclass(frozen=True)
class Added:
    """What an example gets that an effect asks for."""

    path: Path
    words: str
    to: Callable[[Table], Table]


def column(path: Path, values: Callable[[int], Any], *names: str) -> Added:
    """Columns of an example: `values` of the number of its rows."""
    return Added(
        path,
        f"`{names[0]}`" if len(names) == 1 else f"`{names[0]}` to `{names[-1]}`",
        lambda table: table.with_columns(dict.fromkeys(names, values(len(table)))),
    )


ADDED = {
    "time_s": column(ARM, lambda n: 20.0 * np.arange(n), "time_s"),
    "dwell_s": column(ARM, lambda n: np.resize((2.0, 5.0, 20.0), n), "dwell_s"),
    "pressure_1_Pa": column(HINGE, lambda n: 2e4 * (np.arange(n) > n / 2), "pressure_1_Pa"),
    "tension_1_N": Added(ARM, "tensions in place of pressures", tensions),
    "tendon1_N": column(NECK, lambda n: np.full(n, 5.0), *(f"tendon{j}_N" for j in (1, 2, 3))),
    "q1_rad": Added(NECK, f"`{JOINTS[0]}` to `{JOINTS[-1]}`", joints),
    "poses from the encoders": Added(
        NECK, "poses told to be the encoders'", lambda table: table.drop("leds_visible")
    ),
    "[mechanism] free_length_m": Added(
        NECK,
        "`free_length_m` in `[mechanism]`",
        lambda table: table.with_meta(
            replace(table.meta, mechanism={**table.meta.mechanism, "free_length_m": 0.1})
        ),
    ),
    "NAME.raw.parquet": Added(NECK, "samples of the moves between its poses", stream),
    "what else may act": column(HINGE, lambda n: np.resize((0.0, 5.0, 10.0), n), "slider_mm"),
}
"""What an effect may ask for that no example has, by the first words of its `record`."""


@dataclass(frozen=True)
class Shown:
    """The rows that show an effect."""

    path: Path
    form: Effect
    added: tuple[str, ...]

    @property
    def rows(self) -> Rows:
        """Rows of the example with what was added."""
        return rows_of(self.path, self.added)

    @property
    def where(self) -> str:
        """The table in words."""
        more = " and ".join(ADDED[name].words for name in self.added)
        return f"`examples/{self.path.name}`" + (f" *with* {more}" if more else "")


@cache
def drawn(effect: Effect) -> Shown | None:
    """The example that shows an effect with the least added to it, and the form it has there."""
    found = []
    for path in (NECK, HINGE, ARM):
        form = along_few(effect) if path == HINGE else effect
        its_own = full_only(effect) is (path != HINGE) or form is not effect
        added: tuple[str, ...] | None = () if its_own else None
        while added is not None and (lacking := form.missing(rows_of(path, added).table)):
            asked = [name for name in ADDED if lacking.record.startswith(name)]
            known = asked and ADDED[asked[0]].path == path and asked[0] not in added
            added = (*added, asked[0]) if known else None
        if added is not None and np.ptp(left_by(shown := Shown(path, form, added))) > 0.0:
            found.append(shown)
    return min(found, key=lambda shown: len(shown.added), default=None)


def left_by(shown: Shown) -> F:
    """(N, m) what an effect of ordinary size leaves; of noise a draw, without its mean of zero."""
    rows = shown.rows
    form = shown.form.variants(rows.table)[0]
    values = np.array([one.scale for one in form.parameters])
    if isinstance(form, NoiseEffect):
        normal = np.random.default_rng(1).normal(size=rows.wrench.shape)
        return np.einsum("nij,nj->ni", roots(form.variance(rows, values)), normal)
    return correction_of(form, rows, values)


def roots(squares: F) -> F:
    """(N, m, m) symmetric square roots."""
    sizes, axes = np.linalg.eigh(squares)
    return np.asarray((axes * np.sqrt(np.maximum(sizes, 0.0))[:, None]) @ np.swapaxes(axes, 1, 2))


def draw(group: str) -> None:
    """Write the picture of a family: a panel for each effect that an example can show."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the pages need none

    panels = [place for effect in family(group)[1] if (place := drawn(effect))]
    if not panels:
        return
    across = min(len(panels), 3)
    down = -(-len(panels) // across)
    figure = Figure(figsize=(3.4 * across, 2.5 * down), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False)
    for place, shown in zip(axes.flat, panels, strict=False):
        panel(place, shown)
    for place in axes.flat[len(panels) :]:
        place.axis("off")
    figure.savefig(FOLDER / f"{group}.png", dpi=80)


def panel(axes: Any, shown: Shown) -> None:
    """The component that an effect changes most, over what it follows."""
    rows = shown.rows
    loaded = ~rows.unloaded
    left = left_by(shown)[loaded]
    j = int(np.argmax(left.std(axis=0) / rows.wrench[loaded].std(axis=0)))
    name, unit = rows.base.outputs[j].rsplit("_", 1)
    factor, unit = (1e3, "N mm") if unit == "Nm" else (1.0, unit)
    over, label = abscissa(shown, left[:, j], name)
    axes.plot(over[loaded], factor * left[:, j], ".", ms=3, color="#0072b2")
    axes.axhline(0.0, color="#1c2430", lw=0.6)
    size_there = factor * np.sqrt((left[:, j] ** 2).mean())
    axes.set_title(f"{shown.form.id}: {float(f'{size_there:.2g}'):g} {unit} rms", fontsize=9)
    axes.set_xlabel(label, fontsize=8)
    axes.set_ylabel(f"{name} [{unit}]", fontsize=8)
    axes.tick_params(labelsize=7)


def abscissa(shown: Shown, left: F, output: str) -> tuple[F, str]:
    """Values and label: an input, joint or own column that tells most, time, or the pose."""
    rows, table = shown.rows, shown.rows.table
    others = (name for name in (*JOINTS, "slider_mm") if name in table.columns)
    if names := (*actuators_of(rows.base), *others):
        inputs = table.matrix(names)[~rows.unloaded]
        told = np.abs((inputs - inputs.mean(axis=0)).T @ (left - left.mean())) / inputs.std(axis=0)
        best = names[int(np.argmax(told))]
        what, unit = best.replace("_", " ").rsplit(" ", 1)
        factor, unit = {"Pa": (1e-3, "kPa"), "rad": (180.0 / np.pi, "deg")}.get(unit, (1.0, unit))
        return factor * table.column(best), f"{what} [{unit}]"
    if shown.form.kind == "time" and table.continuous:
        return rows.time_s(), "time [s]"
    if shown.form.kind == "time" and shown.path == NECK:
        return rows.time_s() / 60.0, "time [min]"
    partner = {"fx": 0, "fy": 5, "fz": 4, "tau_x": 3, "tau_y": 4, "tau_z": 5}[output]
    at = table.column(POSE[partner])
    if partner == 0:
        return 1e3 * at, "x [mm]"
    return np.rad2deg(at), f"{POSE[partner][:-4]} [deg]"


def pages() -> dict[str, Callable[[], str]]:
    """What writes each page, by the page's name in docs/effects."""
    return {"index.md": index} | {f"{group}.md": partial(page_of, group) for group in GROUPS}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text_of in pages().items():
        (FOLDER / name).write_text(text_of(), encoding="utf-8")
    if "--pictures" in sys.argv:
        for group in GROUPS:
            try:
                draw(group)
            except EcmError as error:
                raise SystemExit(f"{group}: {error}") from error
