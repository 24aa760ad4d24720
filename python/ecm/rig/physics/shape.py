"""What every physical truth of the plant shares: one size, whose unit it names, and its shape."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, TypeVar

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
