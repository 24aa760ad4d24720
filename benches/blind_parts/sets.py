"""The sets of the benchmark: what is hidden in each, by tier; the first N are as mixed as all.

Tiers and numbers of sets are those of the table in docs/discovery.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from blind_parts.rod_tables import EFFECTS as ROD_EFFECTS
from blind_parts.strange import STRANGE
from ecm.effects import all_effects
from ecm.rig.physics import TRUE_EFFECTS

TIER_SETS = {0: 200, 1: 750, 2: 300, 3: 250, 4: 100, 5: 100}
ARM = 6
"""Number of the tier with the full robot: an arm that bends, swings and settles (`ecm.rig.arm`)."""
THREE = 7
"""Number of the tier with three effects at once."""
ALL_SETS = {**TIER_SETS, ARM: 20, THREE: 60}
_CYCLE = {0: 4, 1: 5, 2: 2, 3: 4, 4: 3, 5: 1, ARM: 4, THREE: 1}
"""Pairs of sets after which strengths and kinds of a tier come round again."""
STRENGTHS = (0.2, 0.3, 0.5, 1.0, 3.0)
NOT_TO_BE_NAMED = ("compressibility", "pretension")
"""The first is free in the base, hence never missing; the second needs the detached length, which
these tables do not tell, and is listed as not testable."""
HISTORY = ("hysteresis", "stress_relaxation", "ageing")


@dataclass(frozen=True)
class Set:
    """One set: everything that its data depend on."""

    tier: int
    index: int
    source: str
    """`rig`: the neck by FEM on the simulated rig; `rod`: the second generator; `arm`: the rig with
    its robot in full."""
    hidden: tuple[tuple[str, float], ...] = ()
    strange: str = ""
    """An effect that never was in the library, at `strength`."""
    strength: float = 0.0
    removed: tuple[str, ...] = ()
    """Ids taken out of the library."""
    protocol: str = "diagnosable"
    variant: str = ""
    """`base_error` or `noise`: what is not ideal in a set of tier 0."""

    @property
    def seed(self) -> int:
        """Seed of the data."""
        return 10_000 * (self.tier + 1) + self.index

    @property
    def pair(self) -> int:
        """Number of the pair (one set from each source) that it belongs to."""
        return self.index // 2

    @property
    def round(self) -> int:
        """How often strengths and kinds of its tier have come round before."""
        return self.pair // _CYCLE[self.tier]

    @property
    def name(self) -> str:
        """File name: tier, index and what it holds."""
        text = repr(sorted(asdict(self).items())).encode()
        return f"{self.tier}-{self.index:04d}-{hashlib.sha256(text).hexdigest()[:10]}"

    def to_dict(self) -> dict[str, Any]:
        """For the result file."""
        return asdict(self)


def sets_of(tier: int, count: int | None = None) -> list[Set]:
    """The first `count` sets of a tier."""
    n = ALL_SETS[tier] if count is None else min(count, ALL_SETS[tier])
    return [set_of(tier, i) for i in range(n)]


def set_of(tier: int, index: int) -> Set:
    """One set of a tier; any index, so that there are fresh ones beyond those of the table."""
    return _MAKE[tier](index)


def balanced(sets: Sequence[Set]) -> list[Set]:
    """All tiers side by side, each as far as the others: a run that stops early is a sample."""
    return sorted(
        sets, key=lambda one: ((one.pair + 0.5) / ALL_SETS[one.tier], one.tier, one.index)
    )


@lru_cache(maxsize=3)
def hideable(source: str) -> tuple[str, ...]:
    """Ids that a source can hide and the library can name."""
    known = {effect.id for effect in all_effects()}
    at_rest = [
        name
        for name, kind in TRUE_EFFECTS.items()
        if not (kind.only_in_motion or kind.of_actuators)
    ]
    own = ROD_EFFECTS if source == "rod" else at_rest
    return tuple(sorted(id for id in own if id in known and id not in NOT_TO_BE_NAMED))


def each_of(source: str, strength: float) -> list[Set]:
    """Every effect of a source once, beside the sets of the table."""
    ids = hideable(source)
    return [Set(1, 2000 + k, source, hidden=((id, strength),)) for k, id in enumerate(ids)]


def _source(index: int) -> str:
    return ("rig", "rod")[index % 2]


def _random(tier: int, index: int) -> np.random.Generator:
    return np.random.default_rng([tier, index, 6])


def _nothing(index: int) -> Set:
    variant = ("", "base_error", "", "noise")[(index // 2) % 4]
    return Set(0, index, _source(index), variant=variant)


def _dealt(source: str, deal: int, seed: int) -> str:
    """Cards are dealt without replacement, then shuffled anew."""
    ids = hideable(source)
    round_, place = divmod(deal, len(ids))
    order = np.random.default_rng([seed, round_]).permutation(len(ids))
    return ids[order[place]]


def _one(index: int) -> Set:
    source = _source(index)
    # Strengths change fastest, so that the first ten sets hold each of them from both sources.
    strength = STRENGTHS[(index // 2) % len(STRENGTHS)]
    id = _dealt(source, index // (2 * len(STRENGTHS)), 1)
    # Another effect for every strength: a small run sees more of them.
    ids = hideable(source)
    id = ids[(ids.index(id) + 5 * STRENGTHS.index(strength)) % len(ids)]
    return Set(1, index, source, hidden=((id, strength),))


def _two(index: int) -> Set:
    source, random = _source(index), _random(2, index)
    strength = (0.5, 1.0)[(index // 2) % 2]
    pair = random.choice(hideable(source), 2, replace=False)
    return Set(2, index, source, hidden=tuple((str(id), strength) for id in pair))


def _three(index: int) -> Set:
    source = _source(index)
    chosen = _random(THREE, index).choice(hideable(source), 3, replace=False)
    return Set(THREE, index, source, hidden=tuple((str(id), 1.0) for id in chosen))


def _foreign(index: int) -> Set:
    source, random = _source(index), _random(3, index)
    strength = (0.5, 1.0)[(index // 2) % 2]
    if (index // 4) % 2:
        name = sorted(STRANGE)[(index // 8) % len(STRANGE)]
        return Set(3, index, source, strange=name, strength=strength)
    id = str(random.choice(hideable(source)))
    return Set(3, index, source, hidden=((id, strength),), removed=(id,))


def _paper(index: int) -> Set:
    source = _source(index)
    known = [id for id in HISTORY if id in hideable(source)]
    id = known[(index // 2) % len(known)]
    return Set(4, index, source, hidden=((id, 1.0),), protocol="paper")


def _alike(index: int) -> Set:
    """Every effect in turn, on a plan that lacks the rows that would tell many of them apart."""
    source = _source(index)
    hidden = ((_dealt(source, index // 2, 5), 1.0),)
    return Set(5, index, source, hidden=hidden, protocol="plain")


def _arm(index: int) -> Set:
    """Three quarters hold an effect of the rig, as in tier 1; the others nothing."""
    if index % 4 == 3:
        return Set(ARM, index, "arm", protocol="arm")
    number = index - index // 4
    id = _dealt("rig", number, 2)
    hidden = ((id, STRENGTHS[number % len(STRENGTHS)]),)
    return Set(ARM, index, "arm", hidden=hidden, protocol="arm")


_MAKE = {
    0: _nothing, 1: _one, 2: _two, 3: _foreign, 4: _paper, 5: _alike, ARM: _arm, THREE: _three,
}  # fmt: skip
