"""What a base leaves out: the terms of the next degree, as large as its choice leaves them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F, lstsq, svd

_SEEN = 1e-6
"""Share of the terms of the next degree from which a direction of them is none of the base's."""


@dataclass(frozen=True)
class LeftOut:
    """Directions of the terms of the next degree, which the choice of the base's degree left out.

    What they explain is about the noise along each of them: more would have been taken, for it
    would have lowered the error of prediction. So each is unit long over the rows, beside the base,
    and has a coefficient of standard deviation 1.
    """

    turn: F
    """(k, e) of the terms."""
    of_base: F
    """(b, e) of the columns of the base."""

    @staticmethod
    def of(own: F, every: F) -> LeftOut:
        """Return those of whitened columns of the base (r, b) and of the terms (r, k)."""
        shares = lstsq(own, every, rcond=1e-10)
        _, sizes, turns = svd(every - own @ shares)
        seen = sizes > _SEEN * np.linalg.norm(every)
        turn = turns[seen].T / sizes[seen]
        return LeftOut(turn, shares @ turn)

    def columns(self, base_block: F, terms: F) -> F:
        """(N, m, e) of any rows, from the columns of the base and of the terms there."""
        return terms @ self.turn - base_block @ self.of_base
