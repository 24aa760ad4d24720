"""What every physical truth of the plant shares: one size, whose unit it names, and its shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, TypeVar

from ecm.errors import InputError

T = TypeVar("T", bound="Sized")


@dataclass(frozen=True)
class Sized:
    """A physical truth: `size` scales it, the other fields are its shape."""

    size: float

    unit: ClassVar[str]
    """Of `size`."""

    def resized(self: T, size: float) -> T:
        """The same shape at another size."""
        return replace(self, size=size)

    def parameters(self) -> dict[str, Any]:
        """For the sealed truth."""
        return {"unit": self.unit, **asdict(self)}

    def with_parameters(self: T, known: Mapping[str, Any]) -> T:
        """The truth that `parameters` was read from, which may have gone through JSON.

        Raises
        ------
        InputError
            Where the names are not this truth's.
        """
        own = {field.name for field in fields(self)}
        if set(known) - {"unit"} != own:
            raise InputError(
                f"sealed parameters {', '.join(sorted(set(known) - {'unit'}))}, expected "
                f"{', '.join(sorted(own))}: the truth was sealed by another version"
            )
        return replace(self, **{name: _tuples(known[name]) for name in own})

    def afterwards(self: T) -> T:
        """The same truth in a later campaign: what happens once has happened.

        Processes of time and memory (ageing, creep, set, softening) begin anew.
        """
        return self


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
