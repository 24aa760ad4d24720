"""The mechanism in space: what a picture of it needs of a table, and its block on a page."""

from __future__ import annotations

from typing import Any

import numpy as np

from ecm.io.arrays import F, I, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.report.page import MechanismBlock

_PLACES = 9
_MOST = 1000
"""Rows that a page draws."""


def mechanism_view(body: Mechanism | None, length_m: float | None) -> dict[str, Any]:
    """Return outline and frames of a mechanism.

    Parameters
    ----------
    body
        The elastic body, where it is described.
    length_m
        Distance of the two frames at rest.

    Returns
    -------
    dict
        `length_m`; `outline_m`: radius at places evenly from the base to the top, None where no
        body is described; `frames`: name, origin in m and axes as rows.

    Examples
    --------
    >>> body = Mechanism()
    >>> view = mechanism_view(body, body.length_m)
    >>> view["length_m"], [round(radius, 3) for radius in view["outline_m"]][:3]
    (0.1034, [0.033, 0.033, 0.033])
    """
    frames = [{"name": "base", "origin_m": [0.0, 0.0, 0.0], "axes": np.eye(3).tolist()}]
    if length_m is not None:
        frames.append({"name": "top", "origin_m": [length_m, 0.0, 0.0], "axes": np.eye(3).tolist()})
    return {"length_m": length_m, "outline_m": _outline(body, length_m), "frames": frames}


def view_of(meta: Meta) -> dict[str, Any]:
    """Return `mechanism_view` of what a description says."""
    return mechanism_view(meta.body(), meta.length_m)


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
        (n,) rows that are drawn, from 0; of more than 1,000 some evenly and the largest.
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
    if len(rows) > _MOST:
        chosen = np.union1d(evenly(len(rows), _MOST), np.argsort(-values, kind="stable")[:10])
        caption += (
            f" {len(chosen)} of {len(rows)} rows are drawn: evenly over their order, and the "
        )
        caption += "largest."
        rows, values = rows[chosen], values[chosen]
    body = table.meta.body() or body
    length = table.meta.length_m or (None if body is None else body.length_m)
    view = mechanism_view(body, length)
    columns = {
        name: _short(table.column(name)[rows]) for name in (*POSE, *WRENCH[:3]) if table.has(name)
    }
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
