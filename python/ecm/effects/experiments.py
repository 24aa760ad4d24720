"""Experiments that separate effects that look alike: what is done, its minutes, its readings.

The rivals of an effect name experiments by id; reports show the action. A recipe is the name of a
plan in `ecm.designs.plans`; an experiment without one is done by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ecm.io.columns import POSE
from ecm.io.table import Table

MINUTES_BY_HAND = 30
"""Time taken for an experiment that is not listed here."""
SEPARATOR = " + "
"""Between the actions of one session."""


@dataclass(frozen=True)
class Experiment:
    """One measurement at the rig or by hand.

    Parameters
    ----------
    id
        Name in the rivals of the effects.
    action
        What to do, in plain words; the `action` of a report's `next_experiment`.
    minutes
        Time at the rig, set-up included.
    recipe
        Name of the plan in `ecm.designs.plans` that the rig can drive; empty: done by hand.
    readings
        Standard deviation, by unit, of a reading of an effect's size: effect id -> unit -> sd.
    moving
        The same with a rig that records a motion and has no poses to go to; empty: the action.

    Examples
    --------
    >>> get_experiment("calliper").minutes
    10
    >>> get_experiment("calliper").can_be_driven
    False
    """

    id: str
    action: str
    minutes: int = MINUTES_BY_HAND
    recipe: str = ""
    readings: Mapping[str, Mapping[str, float]] = field(default_factory=dict, hash=False)
    moving: str = ""

    def words(self, table: Table) -> str:
        """What to do with the rig of a table: a log of few columns has no poses to go to."""
        is_motion = table.continuous and not {*POSE} <= {*table.columns}
        return (is_motion and self.moving) or self.action

    @property
    def can_be_driven(self) -> bool:
        """Whether the rig can carry it out without hands."""
        return bool(self.recipe)

    @property
    def campaign(self) -> str:
        """The same for two experiments that one plan carries out; by hand the id itself."""
        return self.recipe or self.id


_LISTED = (
    # Driven by the rig.
    Experiment("repeat_first_poses", "repeat the first 10 poses", 15, "first_poses",
               moving="repeat the first minutes of the motion"),
    Experiment("repeat_next_day", "repeat the first set at the end, and next day", 30,
               "first_poses"),
    Experiment("conditioning_cycles", "5 conditioning cycles, then repeat the first 10 poses", 20,
               "conditioning", moving="5 of the largest cycles, then repeat the first minutes"),
    Experiment("repeat_those_poses", "repeat those poses", 20, "repeats"),
    Experiment("repeat_small_and_large", "repeats at small and large poses", 20, "repeats"),
    Experiment("push_and_pull", "a pair of push and pull poses", 20, "push_and_pull"),
    Experiment("fine_sweep", "fine sweep through the kink", 25, "sweep"),
    Experiment("three_dwells", "dwell of 2, 8 and 60 s", 25, "holds"),
    Experiment("hold_60_s", "hold 60 s", 25, "holds"),
    Experiment("hold_one_pose", "hold one pose for 60 s", 25, "holds",
               moving="stop the motion for 60 s"),
    Experiment("both_sides", "the same pose from both sides, again after 60 s", 30, "both_sides",
               moving="stop at the same place from both sides, again after 60 s"),
    Experiment("home_after_every_sample", "home pose after every sample", 30, "homes"),
    Experiment("return_home", "return home, repeat the first pose", 30, "homes"),
    Experiment("unloaded_zero", "unloaded zero", 30, "zeros"),
    Experiment("zero_every_ten_poses", "unloaded zero every 10 poses", 30, "zeros",
               moving="stop for an unloaded zero every few minutes"),
    Experiment("zero_at_two_orientations", "unloaded zero at two orientations", 30, "zeros"),
    Experiment("warm_and_cold", "repeat 10 poses warm and cold", 80, "warm_and_cold",
               moving="repeat the motion warm and cold"),
    Experiment("zero_warm_and_cold", "unloaded zero warm and cold", 80, "warm_and_cold"),
    Experiment("remove_payload", "remove the payload", 30, "without_payload"),
    Experiment("zero_without_payload", "zero the sensor without the payload", 30,
               "without_payload"),
    Experiment("remount_90", "remount the mechanism turned by 90 degrees", 35, "remount_90"),
    Experiment("remount_180", "remount turned by 180 degrees", 35, "remount_180"),
    Experiment("dead_weights", "dead weights", 45, "dead_weights"),
    Experiment("dead_weights_on_lever", "dead weights on a lever", 45, "dead_weights"),
    Experiment("load_and_unload_weights", "load and unload dead weights", 45, "dead_weights"),
    # By hand, with a reading of an effect's size.
    Experiment("calliper", "calliper", 10,
               readings={"length_error": {"m": 5e-5}, "diameter_error": {"1": 1e-3}}),
    Experiment("detached_length", "measure the detached length", 10,
               readings={"pretension": {"N": 2.0}}),
    Experiment("detach_cable", "detach the cable", 10,
               readings={"cable_drag": {"N/m": 1.0, "N": 0.05, "N m": 2e-3, "N/m^2": 20.0}}),
    Experiment("reseat_marker", "re-seat the marker", 20,
               readings={"tip_frame_misalignment": {"m": 5e-5, "rad": 5e-4}}),
    Experiment("gauge_bar", "gauge bar", 20, readings={"camera_scale": {"1": 1e-3}}),
    Experiment("dial_gauge", "dial gauge on the base plate under load", 20,
               readings={"base_compliance": {"rad/(N m)": 3e-5, "m/N": 2e-7}}),
    Experiment("base_marker", "look at the base marker", 20,
               readings={"marker_motion": {"m": 2e-5, "rad": 3e-4}}),
    Experiment("base_survey", "survey the base", 30,
               readings={"base_frame_misalignment": {"m": 5e-5, "rad": 5e-4}}),
    Experiment("second_camera_place", "a second place of the camera", 30,
               readings={"led_occlusion": {"m": 5e-5, "rad": 1e-3}}),
    # The free sensor is warmed and left to cool, more than once.
    Experiment("warm_up_log", "warm-up log of the sensor's temperature", 60,
               readings={"fts_thermal_drift": {"N/K": 0.02, "N m/K": 1e-3}}),
    # By hand, without a reading that could be predicted.
    Experiment("longer_average", "a longer average"),
    Experiment("static_stream", "a static stream of 60 s"),
    Experiment("camera_calibration", "calibrate with the camera"),
    Experiment("joint_reversal", "joint-wise reversal"),
    Experiment("larger_axial_and_torsion", "larger pure axial and torsion poses"),
    Experiment("pure_torsion_and_axial", "pure torsion and pure axial poses"),
    Experiment("force_at_three_points", "pure force at 3 points"),
    Experiment("moving_log", "log while moving, cross-correlation"),
    Experiment("raw_counts", "look at the raw counts"),
    Experiment("settle_longer", "settle 2 s more"),
    Experiment("slack_tendons", "slack the tendons"),
    Experiment("other_elbow", "the same pose with another elbow"),
    Experiment("end_for_end", "turn the mechanism end for end"),
    Experiment("two_speeds", "two approach speeds"),
)  # fmt: skip
EXPERIMENTS: Mapping[str, Experiment] = {one.id: one for one in _LISTED}
"""All experiments by id."""
_BY_ACTION = {words: one for one in _LISTED for words in (one.action, one.moving) if words}


def get_experiment(name: str) -> Experiment:
    """Return the experiment of an id or of an action; any other text is done by hand.

    Examples
    --------
    >>> get_experiment("repeat the first 10 poses").id
    'repeat_first_poses'
    >>> get_experiment("ask the workshop").minutes
    30
    """
    return EXPERIMENTS.get(name) or _BY_ACTION.get(name) or Experiment(name, name)


def session_of(action: str) -> list[Experiment]:
    """Return the experiments of an action, "a + b" where it is a session of several.

    Examples
    --------
    >>> [one.id for one in session_of("gauge bar + survey the base")]
    ['gauge_bar', 'base_survey']
    """
    return [get_experiment(part) for part in action.split(SEPARATOR)]
