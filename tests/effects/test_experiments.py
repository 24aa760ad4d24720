"""Experiments are records: every rival names one, and each has a price of its own."""

from __future__ import annotations

from ecm.effects import all_effects
from ecm.effects.experiments import EXPERIMENTS, get_experiment, session_of


def test_every_rival_names_a_listed_experiment() -> None:
    named = {name for effect in all_effects() for name in effect.rivals.values()}
    assert named == set(EXPERIMENTS)


def test_actions_are_told_apart_and_read_known_effects() -> None:
    actions = [one.action for one in EXPERIMENTS.values()]
    assert len(set(actions)) == len(actions)
    assert all(get_experiment(one.action) is one for one in EXPERIMENTS.values())
    known = {effect.id: {p.unit for p in effect.parameters} for effect in all_effects()}
    for one in EXPERIMENTS.values():
        for id, errors in one.readings.items():
            assert set(errors) & known[id], (one.id, id)
            assert min(errors.values()) > 0.0


def test_conditioning_is_not_priced_as_repeating_the_first_poses() -> None:
    """Its action names both; the 15 poses of the cycles take time of their own."""
    conditioning = get_experiment("5 conditioning cycles, then repeat the first 10 poses")
    assert conditioning.recipe == "conditioning"
    assert conditioning.minutes == 20
    assert get_experiment("repeat the first 10 poses").minutes == 15


def test_a_session_is_its_parts_and_any_other_text_is_done_by_hand() -> None:
    parts = session_of("calliper + dead weights + ask the workshop")
    assert [one.id for one in parts] == ["calliper", "dead_weights", "ask the workshop"]
    assert [one.can_be_driven for one in parts] == [False, True, False]
    assert [one.minutes for one in parts] == [10, 45, 30]
