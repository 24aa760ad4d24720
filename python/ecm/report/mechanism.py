"""The mechanism in space: what a picture of it needs of a table, and its block on a page."""

from __future__ import annotations

from typing import Any

import numpy as np

from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.report.blocks import MechanismBlock
from ecm.report.figures import drawn_rows, drawn_sentence

_PLACES = 9


def view_of(meta: Meta, body: Mechanism | None = None) -> dict[str, Any]:
    """Return outline and frames of a mechanism.

    Parameters
    ----------
    meta
        What is known of the table.
    body
        The elastic body, where the description has none.

    Returns
    -------
    dict
        `length_m`: distance of the two frames at rest; `outline_m`: radius at places evenly from
        the base to the top, None where no body is described; `frames`: name, origin in m and axes
        as rows.

    Examples
    --------
    >>> view = view_of(Meta(), Mechanism())
    >>> view["length_m"], [round(radius, 3) for radius in view["outline_m"]][:3]
    (0.1034, [0.033, 0.033, 0.033])
    """
    body = meta.body() or body
    length_m = meta.length_m or (None if body is None else body.length_m)
    places = [("base", 0.0)] + ([] if length_m is None else [("top", length_m)])
    frames = [
        {"name": name, "origin_m": [x, 0.0, 0.0], "axes": np.eye(3).tolist()} for name, x in places
    ]
    return {"length_m": length_m, "outline_m": _outline(body, length_m), "frames": frames}


def mechanism_blocks(
    table: Table,
    caption: str,
    *,
    rows: I,
    values: F,
    title: str,
    unit: str,
    body: Mechanism | None = None,
    link: str = "",
) -> list[MechanismBlock]:
    """Return the mechanism bent into its poses; no block where the rows have no place in space.

    Parameters
    ----------
    table
        N rows.
    caption
        What the picture shows.
    rows
        (n,) rows that are drawn, from 0; of many those of `drawn_rows`.
    values
        (n,) that colour them.
    title, unit
        What the values are.
    body
        The body where the description has none.
    link
        A row that is marked here is marked in all figures and tables of the same link.
    """
    if not table.has(*POSE[:3]):
        return []
    chosen = drawn_rows(values[:, None])
    caption += drawn_sentence(values[:, None])
    rows, values = rows[chosen], values[chosen]
    columns = {
        name: _short(table.column(name)[rows]) for name in (*POSE, *WRENCH[:3]) if table.has(name)
    }
    view = view_of(table.meta, body)
    view |= {"row": (rows + 1).tolist(), "columns": columns, "values": _short(values)}
    view |= {"title": title, "unit": unit, "name": caption, "link": link}
    return [MechanismBlock(caption, view)]


def _outline(body: Mechanism | None, length_m: float | None) -> list[float] | None:
    if body is None or not body.has_body or length_m is None:
        return None
    x, y, z = np.asarray(body.mesh().nodes_m).T
    place = np.clip(np.round((_PLACES - 1) * x / length_m), 0, _PLACES - 1).astype(int)
    radius = np.zeros(_PLACES)
    np.maximum.at(radius, place, np.hypot(y, z))
    known = np.flatnonzero(radius)
    return _short(np.interp(np.arange(_PLACES), known, radius[known]))


def _short(values: F) -> list[float]:
    return [float(f"{value:.5g}") for value in np.asarray(values, dtype=float)]
