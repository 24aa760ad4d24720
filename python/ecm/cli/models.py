"""MODEL of a command: a model file, a TOML of a body or of equations, predicted wrenches.

A TOML's [mechanism] is the physics model, its [expression] a model of one's own. A table with a
row for each measured pose is what any other program predicts.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ecm.cli.session import Session
from ecm.errors import InputError, Remedy
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.steps import Progress
from ecm.io.table import Table
from ecm.io.toml import read_toml
from ecm.models import Expression, Model, PhysicsMap, as_model, load_model, physics_map
from ecm.models.physics.map import reach_of

_TABLES = (".csv", ".parquet", ".pq")


def is_toml(name: str) -> bool:
    """Whether MODEL is a TOML, of a body or of equations."""
    return name.lower().endswith(".toml")


def open_model(name: str, session: Session, table: Table | None = None) -> Model:
    """Open MODEL; the physics model is built as wide as the poses of the table reach."""
    if Path(name).suffix.lower() in _TABLES:
        if table is None or not table.wrench_columns:
            raise InputError(
                f"{name}: predicted wrenches are compared with measured ones at the same poses, no "
                "more; here a model file is needed, which fits them",
                remedy=Remedy("fit a model to them", f"ecm fit {name} --model linear --out OUT"),
            )
        return as_model(Path(name), table)
    if not is_toml(name):
        return load_model(Path(name))
    own = read_own(name)
    if isinstance(own, Mechanism):
        return Model(base=build_physics(own, session, table))
    if table is not None and table.wrench_columns:
        return as_model(own, table)
    return Model(base=own.map())


def build_physics(body: Mechanism, session: Session, table: Table | None) -> PhysicsMap:
    """Build the FEM of a body, with progress where it is not in the cache."""
    reach = 0.0 if table is None else reach_of(table)
    return physics_map(
        body, threads=session.threads, progress=_late_progress(session), reach_rad=reach
    )


def prepare_physics(table: Table, session: Session) -> None:
    """Build the physics of the table's [mechanism], if it has a body, for a later comparison."""
    body = table.meta.elastic_body()
    if body is not None and table.has(*POSE, *WRENCH):
        build_physics(body, session, table)


def read_own(name: str) -> Expression | Mechanism:
    """Read [expression] of a TOML, else [mechanism]; its other tables are ignored."""
    path = Path(name)
    document = read_toml(path, "description of a model")
    if "expression" in document:
        return Expression.from_dict(document["expression"], f"{path} [expression]")
    if "mechanism" not in document:
        raise InputError(
            f"{path}: no table [mechanism] and no table [expression], expected one: the body of "
            "the physics model, or equations of your own"
        )
    where = f"{path} [mechanism]"
    return Mechanism.from_dict(document["mechanism"], where, base=path.parent)


def _late_progress(session: Session) -> Progress:
    """A progress bar that appears only when there is work to do."""
    bars: list[Callable[..., None] | None] = []

    def show(done: float, total: float, phase: str) -> None:
        if not bars:
            bars.append(session.progress("FEM of the body, kept for the next time"))
        if bars[0] is not None:
            bars[0](done, total, phase)

    return show
