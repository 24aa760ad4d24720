"""Write docs/effects/: a page for each family of effects, from the classes of the catalogue.

    python docs/effects_pages.py               # the pages
    python docs/effects_pages.py --pictures    # and a picture of each family

A class gives its sentence of physics, its formula (the docstring), forms (the fields), parameters,
columns and look-alikes. Words that stand here are those that all effects share.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import ecm
from ecm.effects import Effect, Parameter, all_effects, effects_for
from ecm.effects.experiments import get_experiment
from ecm.effects.protocol import correction_of
from ecm.effects.registry import _GROUPS as GROUPS
from ecm.effects.registry import effects_of_actuators
from ecm.errors import EcmError
from ecm.io.columns import POSE, WRENCH
from ecm.io.settings import meanings
from ecm.logs import import_log
from ecm.regression.rows import Rows

ROOT = Path(__file__).parents[1]
FOLDER = Path(__file__).with_name("effects")
NECK = ROOT / "examples" / "neck_measured.csv"
HINGE = ROOT / "examples" / "hinge_log.csv"
ARM = ROOT / "examples" / "wound_arm_pairs.csv"
FEW = (POSE[5], WRENCH[5])
TWELVE = "the twelve columns of pose and wrench"
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
            shown.setdefault(f"`examples/{place[0].name}`", []).append(f"`{effect.id}`")
    if shown:
        where = "; ".join(
            f"{', '.join(names)} on the rows of {path}" for path, names in shown.items()
        )
        lines.append(
            f"![What each effect leaves in the residual, at its ordinary size]({group}.png)\n\n"
            "What an effect at its ordinary size leaves in the residual of a model without it, in "
            f"the component that it changes most: {where}.\n"
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
    formula, *more = (inspect.getdoc(type(effect)) or "").split("\n\n")
    papers = [text(part).removeprefix("Source: ") for part in more if part.startswith("Source: ")]
    more = [part for part in more if not part.startswith("Source: ")]
    yield f"**Formula.** {text(formula)}\n"
    yield from (f"{text(part)}\n" for part in more)
    forms = meanings(type(effect)) if hasattr(effect, "__dataclass_fields__") else {}
    shown = {
        name: what for name, what in forms.items() if what and name in type(effect).__annotations__
    }
    if shown:
        yield "Its forms differ in\n"
        yield from (f"- `{name}`: {text(what)}" for name, what in shown.items())
        yield ""
    parameters, there = effect.parameters, ""
    if not parameters and (place := drawn(effect)):
        path, form = place
        parameters = form.variants(rows_of(path).table)[0].parameters
        there = f" (for the columns of `examples/{path.name}`)" if parameters else ""
    none = "It has no parameters" if effect.kind == "noise" else BY_COLUMNS
    own = sizes(parameters) + there if parameters else none
    yield f"**Sizes.** {own}.\n"
    needs = effect.needs or "nothing beside pose and wrench"
    few = along_few(effect)
    own = needs.rstrip(".")
    if few is not effect and few.id == effect.id:
        own += f"; with fewer than the twelve columns: {few.needs or 'nothing more'}"
    elif not full_only(effect):
        own += "; any columns of pose and wrench"
    yield f"**Columns:** {safe(own)}.\n"
    if effect.signature:
        yield f"**How it shows.** {safe(effect.signature[0].upper() + effect.signature[1:])}.\n"
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
    yield f"**Source.** {''.join(f'{paper} ' for paper in papers)}Code: {code}.\n"


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
    return next((form for form in effects_for(FEW) if form.id == effect.id), effect)


def full_only(effect: Effect) -> bool:
    """Whether an effect has a form along all twelve columns of pose and wrench."""
    return any(effect.id == one.id for one in (*all_effects(), *effects_of_actuators()))


def link(id: str) -> str:
    """A link to an effect."""
    for group in GROUPS:
        if any(effect.id == id for effect in family(group)[1]):
            return f"[`{id}`]({group}.md#{id})"
    return f"`{id}`"


def sizes(parameters: tuple[Parameter, ...]) -> str:
    """Ordinary size and bounds of parameters in words, alike ones together."""
    groups: dict[str, list[str]] = {}
    for one in parameters:
        ends = [size(end, one.unit) for end in (one.lower, one.upper) if np.isfinite(end)]
        bounds = ""
        if np.isfinite(one.lower) and np.isfinite(one.upper):
            bounds = f", from {ends[0]} to {ends[1]}"
        elif ends:
            bounds = f", at {'least' if np.isfinite(one.lower) else 'most'} {ends[0]}"
        groups.setdefault(f"ordinarily about {size(one.scale, one.unit)}{bounds}", []).append(
            one.name
        )
    return "; ".join(f"{some(names)}: {words}" for words, names in groups.items())


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
    if below == "s" and value < 2e-4:
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
def rows_of(path: Path) -> Rows:
    """The rows of an example under a base that was fitted to them."""
    if path == HINGE:
        return under(import_log(HINGE, axis="z", meta=HINGE.with_suffix(".toml")).table, "cubic")
    return under(ecm.read_table(path), "actuated4" if path == ARM else "energy4")


def under(table: ecm.Table, name: str) -> Rows:
    """Rows under the base of this name."""
    return Rows(table, ecm.fit(table, name).base)


def drawn(effect: Effect) -> tuple[Path, Effect] | None:
    """The example that shows an effect, and the form that it has there."""
    if effect.kind == "noise" or effect.id.startswith("unused"):
        return None
    for path in (NECK, HINGE, ARM):
        form = along_few(effect) if path == HINGE else effect
        its_own = full_only(effect) is (path != HINGE) or form is not effect
        if its_own and form.missing(rows_of(path).table) is None:
            return path, form
    return None


def draw(group: str) -> None:
    """Write the picture of a family: a panel for each effect that an example can show."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the pages need none

    effects = [effect for effect in family(group)[1] if drawn(effect)]
    if not effects:
        return
    across = min(len(effects), 3)
    down = -(-len(effects) // across)
    figure = Figure(figsize=(3.4 * across, 2.5 * down), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False)
    for place, effect in zip(axes.flat, effects, strict=False):
        panel(place, *drawn(effect))
    for place in axes.flat[len(effects) :]:
        place.axis("off")
    figure.savefig(FOLDER / f"{group}.png", dpi=80)


def panel(axes: Any, path: Path, effect: Effect) -> None:
    """The component that an effect changes most, over what it follows."""
    rows = rows_of(path)
    form = effect.variants(rows.table)[0]
    values = np.array([one.scale for one in form.parameters])
    loaded = ~rows.unloaded
    left = correction_of(form, rows, values)[loaded]
    j = int(np.argmax(left.std(axis=0) / rows.wrench[loaded].std(axis=0)))
    name, unit = rows.base.outputs[j].rsplit("_", 1)
    factor, unit = (1e3, "N mm") if unit == "Nm" else (1.0, unit)
    if effect.kind == "time" and rows.table.has("time_s") and path == NECK:
        over, label = rows.time_s() / 60.0, "time [min]"
    else:
        partner = {"fx": 0, "fy": 5, "fz": 4, "tau_x": 3, "tau_y": 4, "tau_z": 5}[name]
        at = rows.table.column(POSE[partner])
        over, label = (
            (1e3 * at, "x [mm]")
            if partner == 0
            else (np.rad2deg(at), f"{POSE[partner][:-4]} [deg]")
        )
    axes.plot(over[loaded], factor * left[:, j], ".", ms=3, color="#0072b2")
    axes.axhline(0.0, color="#1c2430", lw=0.6)
    size_there = factor * np.sqrt((left[:, j] ** 2).mean())
    axes.set_title(f"{effect.id}: {size_there:.2g} {unit} rms", fontsize=9)
    axes.set_xlabel(label, fontsize=8)
    axes.set_ylabel(f"{name} [{unit}]", fontsize=8)
    axes.tick_params(labelsize=7)


def pages() -> dict[str, str]:
    """Every page by its name in docs/effects."""
    return {"index.md": index()} | {f"{group}.md": page_of(group) for group in GROUPS}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, written_text in pages().items():
        (FOLDER / name).write_text(written_text, encoding="utf-8")
    if "--pictures" in sys.argv:
        for group in GROUPS:
            try:
                draw(group)
            except EcmError as error:
                raise SystemExit(f"{group}: {error}") from error
