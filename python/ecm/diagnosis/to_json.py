"""Plain JSON of typed results, by one converter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from ecm.models.joint_fit import FittedEffect


def to_json(value: Any) -> Any:
    """Return plain JSON of results: records become objects, tuples lists.

    A field's metadata may change its key (`json`; empty: left out) or leave out a value that is
    None or empty (`optional`). A `to_dict` of the record's own goes first.

    Examples
    --------
    >>> from ecm.diagnosis.check import NotTestable
    >>> to_json((NotTestable("ageing", "no column time_s", "time_s"),))
    [{'id': 'ageing', 'reason': 'no column time_s', 'record': 'time_s'}]
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return fields_json(value)
    if isinstance(value, Mapping):
        return {key: to_json(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(entry) for entry in value]
    return value


def fields_json(record: Any) -> dict[str, Any]:
    """Return the fields of a record as plain JSON."""
    if isinstance(record, FittedEffect):
        return _effect_json(record)
    pairs = [(item, getattr(record, item.name)) for item in fields(record)]
    return {
        item.metadata.get("json", item.name): to_json(value)
        for item, value in pairs
        if item.metadata.get("json", item.name)
        and not (item.metadata.get("optional") and value in (None, ()))
    }


def _effect_json(item: FittedEffect) -> dict[str, Any]:
    parameters = {
        parameter.name: {"value": float(value), "sd": float(sd), "unit": parameter.unit}
        for parameter, value, sd in zip(item.effect.parameters, item.values, item.sd, strict=True)
    }
    return {"id": item.id, "shape": item.effect.shape, "parameters": parameters}
