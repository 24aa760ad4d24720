"""The steps of a work, told to who waits for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

Progress = Callable[[int, int, str], object]
"""Called with the part that is done, the whole, and the name of the step that begins."""


class Steps:
    """Tells which step begins and how much of the work is done before it.

    Parameters
    ----------
    shares
        Share of each step in the time, in order, as whole numbers.
    progress
        Called when a step begins; None: nobody waits.

    Examples
    --------
    >>> told = []
    >>> steps = Steps({"errors": 2, "maps": 1}, lambda *what: told.append(what))
    >>> steps.begin("errors")
    >>> steps.begin("maps")
    >>> told
    [(0, 3, 'errors'), (2, 3, 'maps')]
    """

    def __init__(self, shares: Mapping[str, int], progress: Progress | None) -> None:
        self._shares, self._progress = dict(shares), progress

    def begin(self, name: str) -> None:
        """Tell that this step begins."""
        if self._progress is None:
            return
        names = list(self._shares)
        done = sum(self._shares[before] for before in names[: names.index(name)])
        self._progress(done, sum(self._shares.values()), name)
