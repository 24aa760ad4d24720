"""The table: figures of a record, medians and ranges over seeds, a bench that goes on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import benchmark as module
from benchmark import BY_SHAPE, WITHOUT, Bench, table_lines
from experiment import Record
from robot import HeadSettings
from support.head_example import closed_neck


def test_the_figures_of_a_record_are_those_of_its_ends() -> None:
    wanted = np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], (100, 1))
    reached = wanted.copy()
    reached[:50, 1] += 0.004  # on the way
    reached[80:, 2] -= 0.001
    reached[80:, 5] += np.radians(0.3)
    forces = np.full((100, 4), 30.0)
    forces[60, 2] = 4.0
    limited = np.where(np.arange(100) < 10, 1.0, 0.0)
    record = Record("x", wanted, reached, forces, limited, ((80, 100),))
    figures = record.figures()
    assert figures["settled_mm"] == pytest.approx(1.0)
    assert figures["settled_deg"] == pytest.approx(0.3)
    assert figures["tracking_mm"] == pytest.approx(np.sqrt(0.5 * 16.0 + 0.2 * 1.0))
    assert figures["least_force_N"] == 4.0
    assert figures["limited_share"] == pytest.approx(0.1)


def test_overshoot_is_what_goes_beyond_the_end_of_a_way() -> None:
    wanted = np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], (50, 1))
    wanted[10:, 4] = 0.2
    reached = wanted.copy()
    reached[20:25, 4] += 0.01
    reached[25:30, 3] += 0.05  # across the way
    record = Record("x", wanted, reached, np.ones((50, 4)), np.zeros(50), ((40, 50),))
    assert record.figures()["overshoot_deg"] == pytest.approx(np.degrees(0.01))


def test_the_table_shows_medians_with_their_range_and_falls() -> None:
    def result(seed: int, settled: float) -> dict[str, object]:
        names = (
            WITHOUT,
            BY_SHAPE,
            "set points",
            "saccade",
            "nod 0.5 Hz",
            "nod 1.5 Hz",
            "push",
            "payload",
            "hour of warming",
        )
        figures = Record(
            "x", np.zeros((1, 6)), np.zeros((1, 6)), np.full((1, 4), 9.0), np.zeros(1), ((0, 1),)
        ).figures()
        own = figures | {"settled_mm": settled, "fallen": seed == 2}
        motions = [own | {"motion": name} for name in names]
        margins = {"delay_margin_s": 0.01 + 0.001 * seed, "delay_margin_shape_s": 0.02}
        return {"row": "energy6, 50 poses", "seed": seed, "motions": motions, **margins}

    def set_points(seed: int) -> dict[str, object]:
        whole = result(seed, 0.2)
        return {"row": whole["row"], "seed": seed, "motions": whole["motions"][:3]}  # type: ignore[index]

    lines = table_lines([result(seed, 0.4 + 0.1 * seed) for seed in range(5)])
    assert len(lines) == 7
    assert "| energy6, 50 poses (fell with 1 of 5 seeds) | 5 | 0.60 (0.42 to 0.78) |" in lines[2]
    assert "| 2 |" in lines[2]  # seeds 0 and 1 are within 0.5 mm and 0.2 degrees
    assert "| 12 (10 to 14) | 20 (20 to 20) |" in lines[6]
    # A seed that only went to the set points is in the first table alone.
    more = table_lines([*(result(seed, 0.4) for seed in range(3)), set_points(3)])
    assert more[2].startswith("| energy6, 50 poses (fell with 1 of 4 seeds) | 4 |")
    assert more[6].startswith("| energy6, 50 poses (fell with 1 of 3 seeds) | 3 |")


def test_a_bench_goes_on_where_it_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[tuple[str, int]] = []

    class Quick(Bench):
        def one(self, row, seed, motions, push):  # type: ignore[no-untyped-def]
            assert len(motions) == (2 if seed < 1 else 1)
            called.append((row, seed))
            return {"row": row, "seed": seed, "motions": [{}] * (len(motions) + 2)}

    monkeypatch.setattr(module, "Motions", lambda *arguments: _NoMotions())
    bench = Quick(closed_neck(), HeadSettings(), tmp_path)
    for seed, row in ((0, "no model (PD)"), (0, "energy6, 50 poses"), (1, "no model (PD)")) * 2:
        bench.run(seed, row, full=1)
    assert len(called) == len(set(called)) == 3
    assert len(bench.results()) == 3
    assert all(json.loads(path.read_bytes()) for path in tmp_path.glob("*.json"))


class _NoMotions:
    def all(self) -> tuple[None, None]:
        return None, None

    def pushed(self) -> None:
        return None
