"""What every result does: a line at a prompt, all words where it is printed, and plain JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from html import escape
from typing import Any


class Printed:
    """A result that prints its words; at a prompt it is their first line.

    A subclass says its words by `__str__`.

    Examples
    --------
    >>> class Answer(Printed):
    ...     def __str__(self) -> str:
    ...         return "error 0.9 times the noise\\nfx_N 0.9"
    >>> Answer()
    <Answer: error 0.9 times the noise>
    >>> Answer()._repr_html_()
    '<pre>error 0.9 times the noise\\nfx_N 0.9</pre>'
    """

    def __repr__(self) -> str:
        """The first line of the words."""
        return f"<{type(self).__name__}: {str(self).partition(chr(10))[0]}>"

    def _repr_html_(self) -> str | None:
        """Show the words in a notebook."""
        return f"<pre>{escape(str(self))}</pre>"


def to_json(value: Any) -> Any:
    """Return plain JSON of results: records become objects, tuples lists.

    A field's metadata may change its key (`json`; empty: left out) or leave out a value that is
    None or empty (`optional`). A `to_dict` of the record's own goes first.

    Examples
    --------
    >>> from ecm.errors import Remedy
    >>> to_json({"remedies": (Remedy("add a length", None),)})["remedies"][0]["words"]
    'add a length'
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
    pairs = [(item, getattr(record, item.name)) for item in fields(record)]
    return {
        item.metadata.get("json", item.name): to_json(value)
        for item, value in pairs
        if item.metadata.get("json", item.name)
        and not (item.metadata.get("optional") and value in (None, ()))
    }
