"""What analyses of the same data share is worked out once: problem and search.

Neither knows the seed or the folds, so that a further analysis of the same data only repeats what
depends on them; parts of the report that no score reads are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

from ecm.diagnosis import decide as judge
from ecm.diagnosis import procedure
from ecm.diagnosis.problem import Problem

SHARED = ("assemble", "search", "noise_findings")
"""Of `ecm.diagnosis.decide`."""
UNREAD: dict[str, Callable[..., Any]] = {
    "next_experiments": lambda *a, **k: [],
    "detection_limits": lambda *a, **k: {},
    "refinements": lambda *a, **k: [],
    "confusable_pairs": lambda *a, **k: [],
    "ceiling_rms": lambda *a, **k: None,
    "signature_shares": lambda *a, **k: {},
}
"""Functions of `ecm.diagnosis.procedure` whose value stands in the report alone; `describe` of
`judge` as well."""


class Work:
    """Results of the shared steps of one analysis, in the order of its calls."""

    def __init__(self) -> None:
        self._kept: dict[str, list[Any]] = {name: [] for name in SHARED}

    @property
    def problem(self) -> Problem:
        """The linearised problem that the analysis ended with."""
        found: Problem = self._kept["assemble"][-1]
        return found

    @contextmanager
    def recorded(self) -> Iterator[None]:
        """Keep what the shared steps return."""

        def kept(name: str) -> Callable[..., Any]:
            real = getattr(judge, name)

            def step(*given: Any, **named: Any) -> Any:
                found = real(*given, **named)
                self._kept[name].append(found)
                return found

            return step

        with ExitStack() as stack:
            for name in SHARED:
                stack.enter_context(mock.patch.object(judge, name, kept(name)))
            yield

    @contextmanager
    def replayed(self) -> Iterator[None]:
        """Return the same again; what no score reads is not worked out."""
        with ExitStack() as stack:
            for name in SHARED:
                stack.enter_context(mock.patch.object(judge, name, self._again(name)))
            stack.enter_context(only_the_answer())
            yield

    def _again(self, name: str) -> Callable[..., Any]:
        real, left = getattr(judge, name), iter(self._kept[name])

        def step(*given: Any, **named: Any) -> Any:
            found = next(left, None)
            return real(*given, **named) if found is None else found

        return step


@contextmanager
def only_the_answer() -> Iterator[None]:
    """`diagnose` without those parts of the report that the verdict does not depend on."""
    with ExitStack() as stack:
        stack.enter_context(
            mock.patch.object(judge, "describe_residual", return_value={"words": ""})
        )
        for name, nothing in UNREAD.items():
            stack.enter_context(mock.patch.object(procedure, name, nothing))
        yield
