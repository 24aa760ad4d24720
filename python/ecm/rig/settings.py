"""The rig file: tables [rig] [instrument] [plant] [hidden], each a frozen dataclass.

Every figure is a setting of the user, none is a vendor's. Instrument figures are per sample; the
campaign writes those of the averaged row into the measurement table. The keys of [rig] that only
mode = "robot" has are `ArmSettings`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from ecm.errors import InputError, Remedy
from ecm.io.settings import Checked, check_keys, read_sections, read_settings, setting
from ecm.rig.truth import Hidden


@dataclass(frozen=True)
class ArmSettings:
    """[rig] with mode = "robot": controllers, limits and scene of the simulated arm."""

    step_s: float = setting(1e-3, low=1e-5, high=2e-3)
    """Time step of the simulation and of the controllers, s."""
    impedance_N_m: float = setting(5000.0, low=10.0, high=5000.0)
    """Stiffness of the impedance control, each axis, N/m."""
    impedance_Nm_rad: float = setting(300.0, low=1.0, high=300.0)
    """Stiffness of the impedance control, each axis, N m/rad."""
    damping_ratio: float = setting(0.7, low=0.05, high=2.0)
    """Damping ratio of each mode of arm, controller and mechanism."""
    nullspace_Nm_rad: float = setting(50.0, low=0.0, high=500.0)
    """Stiffness that keeps the elbow as at home, N m/rad."""
    joint_stiffness_Nm_rad: float = setting(30000.0, low=100.0, high=1e6)
    """Stiffness of the joint position control, N m/rad."""
    joint_damping_ratio: float = setting(1.0, low=0.05, high=5.0)
    """Damping ratio of the joint position control."""
    joint_friction: float = setting(0.0, low=0.0, high=1.0)
    """Share of the published joint friction that acts."""
    joint_yield_rad_Nm: float = setting(0.0, low=0.0, high=1e-3)
    """Compliance behind each encoder, position control, rad/(N m)."""
    feed_forward: bool = setting(True)
    """Whether the position control adds the wrench of the controller's model."""
    controller_model: str = setting("")
    """Model file of the controller (`ecm fit`); empty: energy4 fitted to the plan's FEM."""
    elbow_rad: float = setting(0.0, low=-1.5, high=1.5)
    """Swivel angle of the elbow at home, 0 is up, rad."""
    settle_limit_s: float = setting(3.0, low=0.05, high=60.0)
    """Longest wait for the arm to come to rest, s."""
    reach_tolerance_m: float = setting(2e-4, low=1e-7, high=0.1)
    """Accepted distance from the goal, by the encoders, m."""
    reach_tolerance_rad: float = setting(1e-3, low=1e-7, high=0.5)
    """Accepted angle from the goal, by the encoders, rad."""
    force_limit_N: float = setting(300.0, low=1.0, high=1e4)
    """Largest norm of the force at the top frame, N."""
    torque_limit_Nm: float = setting(20.0, low=0.1, high=1e3)
    """Largest norm of the torque at the top frame, N m."""
    contact_limit_N: float = setting(15.0, low=0.1, high=1e4)
    """Largest force that the model does not explain, N."""
    speed_limit_m_s: float = setting(0.25, low=1e-3, high=2.0)
    """Largest speed of the top frame, m/s."""
    singularity_limit: float = setting(0.05, low=0.0, high=1.0)
    """Smallest singular value of the Jacobian with lengths divided by 0.4 m."""
    joint_margin_rad: float = setting(0.035, low=0.0, high=1.0)
    """Distance kept from the end of each joint's range, rad."""
    stop_m: float = setting(0.0, low=0.0, high=1.0)
    """Gap between target plate and a wall at positive y, m; 0: no wall."""
    processes: int = setting(0, low=0, high=1024)
    """Processes that simulate; 0: one per core, at most 8."""


TABLES = ("rig", "instrument", "plant", "hidden")
_RETIRED = "fault"
"""A key of older files, of which only the empty value means something: nothing."""
LOWEST_STREAM_HZ = 0.1
"""Below it many a way is passed without a sample."""


@dataclass(frozen=True)
class Procedure:
    """[rig]: how the poses are visited and how long that takes.

    A pose is approached from home (`initial`) or from the pose before (`previous`), with a cubic
    timing law; poses beyond a limit are skipped with the reason. `offset_compensation` subtracts
    from each reading the line in time between the unloaded readings before and after it
    (`linear`), the last one (`before`), nothing, or a line in the sensor's temperature and time
    and then `linear` on what is left (`temperature`). `stream_Hz` writes NAME.raw.parquet, one row
    per image: 0.1 Hz at least and camera_rate_Hz at most.

    Examples
    --------
    >>> Procedure(dwell_s=5.0).dwell_s
    5.0
    """

    mode: str = setting("quasi_static", choices=("quasi_static", "robot"))
    """A rig at rest in each window, or the arm."""
    approach: str = setting("initial", choices=("initial", "previous"))
    """Start of each way, unless the plan says."""
    dwell_s: float = setting(2.0, low=0.0, high=1e5)
    """Rest before a reading, unless the plan says, s."""
    window_s: float = setting(0.2, low=1e-3, high=1e3)
    """Time over which a reading is averaged, s."""
    speed_m_s: float = setting(0.02, low=1e-5, high=10.0)
    """Peak speed of translation, m/s."""
    speed_rad_s: float = setting(0.15, low=1e-4, high=100.0)
    """Peak speed of rotation, rad/s."""
    pose_error_m: float = setting(1.5e-4, low=0.0, high=5e-3)
    """Scatter of reached positions per axis, m."""
    pose_error_rad: float = setting(1e-3, low=0.0, high=0.05)
    """Scatter of reached rotations per axis, rad."""
    offset_compensation: str = setting(
        "linear", choices=("linear", "before", "none", "temperature")
    )
    """Zero of the sensor by unloaded readings; `temperature` also fits its drift."""
    offset_every: int = setting(50, low=0, high=1_000_000)
    """Poses between two unloaded readings; 0: only at both ends."""
    offset_window_s: float = setting(60.0, low=1e-2, high=1e5)
    """Time over which an unloaded reading is averaged, s."""
    follow_s: float = setting(5.0, low=0.0, high=1e5)
    """Time in which the robot follows a driven mechanism to its free pose, s."""
    free_N: float = setting(0.02, low=0.0, high=100.0)
    """Force at which a driven mechanism counts as free, with 0.033 N m per N, N."""
    unload_s: float = setting(60.0, low=0.0, high=1e5)
    """Time to free the sensor, and to connect it again, s."""
    handling_s: float = setting(600.0, low=0.0, high=1e6)
    """Time of a remount, payload or dead weight, s."""
    stream_Hz: float = setting(0.0, low=0.0, high=1e4)
    """Rate of the raw stream, Hz; 0: none."""
    rotation_limit_rad: float = setting(1.5, low=0.0, high=3.1)
    """Largest rotation of a pose, rad."""
    stretch_limit: float = setting(0.8, low=0.0, high=10.0)
    """Largest displacement of a pose over the length."""


@dataclass(frozen=True)
class Instruments:
    """[instrument]: force-torque sensor, camera, thermometers; figures of one sample.

    A reading beyond the range is clipped, axis by axis. The diagonal of `fts_crosstalk` is not
    used: that is the gain's. The camera's errors of position and rotation are constant while the
    target rests, so a window does not average them, and new at each visit: all LEDs share them
    (`common`), or each LED has an error of camera_error_m and the pose is that of the rigid fit
    (`independent`). At an LED angle of 0.9 rad four or more are seen, up to a tilt of 0.8 rad. The
    motion that the base target shows is subtracted. With `frames = "calibrated"` both targets and
    the sensor are where a calibration with these instruments finds them, a little off.

    Examples
    --------
    >>> Instruments(force_noise_N=1.0).force_noise_N
    1.0
    """

    force_noise_N: float = setting(3.0, low=0.0, high=1e4)
    """White noise of a sample per force axis, N."""
    torque_noise_Nm: float = setting(0.1, low=0.0, high=1e3)
    """White noise of a sample per torque axis, N m."""
    force_noise_per_load: float = setting(0.0, low=0.0, high=1.0)
    """Noise per load of each axis, added in squares."""
    fts_rate_Hz: float = setting(500.0, low=1.0, high=1e6)
    """Samples per second of the force-torque sensor, Hz."""
    fts_range: tuple[float, ...] = setting((400.0, 200.0, 200.0, 20.0, 20.0, 20.0), low=1e-9)
    """Range per axis, N and N m."""
    fts_resolution: tuple[float, ...] = setting((0.1, 0.05, 0.05, 5e-3, 5e-3, 5e-3), low=0.0)
    """One count, N and N m; 0: none."""
    fts_gain: tuple[float, ...] = setting((1.0,) * 6, low=0.1, high=10.0)
    """Reading over true wrench of each axis."""
    fts_crosstalk: tuple[float, ...] = setting((0.0,) * 36, low=-100.0, high=100.0)
    """Reading of axis i per load of axis j, row by row."""
    fts_thermal_per_K: tuple[float, ...] = setting((0.0,) * 6, low=-100.0, high=100.0)
    """Drift of each zero, N/K and N m/K."""
    top_from_sensor: tuple[float, ...] = setting(
        (0.01, 0.0, 0.0, 0.9659258262890683, 0.25881904510252074, 0.0, 0.0), low=-10.0, high=10.0
    )
    """Sensor frame in the top frame: position in m, unit quaternion w x y z."""
    frames: str = setting("known", choices=("known", "calibrated"))
    """Frames as they are, or as a calibration with these instruments finds them."""
    zeroed_with_payload: bool = setting(False)
    """Whether the sensor was zeroed with the payload on it, at the rest pose."""
    camera_rate_Hz: float = setting(60.0, low=1.0, high=1e5)
    """Images per second, Hz."""
    camera_error_m: float = setting(37e-6, low=0.0, high=0.1)
    """Position error per axis and visit, m."""
    camera_error_rad: float = setting(4e-4, low=0.0, high=0.5)
    """Rotation error per axis and visit, rad."""
    led_errors: str = setting("common", choices=("common", "independent"))
    """One error of the pose, or one of each LED."""
    camera_place_m: tuple[float, ...] = setting((0.1, 0.5, 1.4), low=-100.0, high=100.0)
    """Middle of the three lenses, base axes, m."""
    lens_spread_m: float = setting(0.3, low=0.0, high=10.0)
    """Distance from one lens to the next, m."""
    led_radius_m: float = setting(0.05, low=1e-3, high=1.0)
    """Radius of the dome that carries the nine LEDs, m."""
    led_angle_rad: float = setting(0.9, low=0.05, high=3.1)
    """Largest angle at which an LED is seen, rad."""
    camera_drift_m: float = setting(0.0, low=0.0, high=0.1)
    """Slow motion of the camera on its stand per axis, m."""
    camera_drift_rad: float = setting(0.0, low=0.0, high=0.5)
    """Slow rotation of the camera on its stand, rad."""
    base_target: bool = setting(True)
    """Whether a target at the base shows the camera's motion."""
    base_target_images: int = setting(600, low=1, high=1_000_000)
    """Images of the base target per average."""
    clock_skew: float = setting(0.0, low=-0.1, high=0.1)
    """How fast the recorder's clock runs, as a share."""
    time_stamp_sd_s: float = setting(0.0, low=0.0, high=10.0)
    """Scatter of a row's time stamp, s."""
    camera_jitter_m: float = setting(2e-5, low=0.0, high=0.1)
    """White noise of position from image to image, m."""
    camera_jitter_rad: float = setting(1e-4, low=0.0, high=0.5)
    """White noise of rotation from image to image, rad."""
    outlier_share: float = setting(0.0, low=0.0, high=0.5)
    """Share of windows in which an LED is mistaken."""
    outlier_scale: float = setting(8.0, low=1.0, high=1e3)
    """Error of such a window over the usual one."""
    thermometer_noise_degC: float = setting(0.05, low=0.0, high=100.0)
    """White noise of a thermometer, degC."""
    thermometer_lag_s: float = setting(60.0, low=0.0, high=1e5)
    """Lag of the probe behind the mechanism, s."""


@dataclass(frozen=True)
class PlantTable:
    """[plant]: the true surroundings of the mechanism; its own material is in `[mechanism]`.

    The seed draws the sensor's offset and the direction of its warm-up, which the compensation
    sees. The payload is declared in the data.

    Examples
    --------
    >>> PlantTable(room_temperature_degC=20.0).room_temperature_degC
    20.0
    """

    room_temperature_degC: float = setting(22.0, low=-50.0, high=100.0)
    """Mean temperature of the room, degC."""
    room_cycle_degC: float = setting(1.5, low=0.0, high=50.0)
    """Amplitude of the heating's cycle, degC."""
    room_cycle_s: float = setting(2700.0, low=1.0, high=1e6)
    """Period of the heating's cycle, s."""
    room_wander_degC: float = setting(0.7, low=0.0, high=50.0)
    """Slow random part (Ornstein-Uhlenbeck, 1 h), degC."""
    thermal_lag_s: float = setting(600.0, low=1.0, high=1e6)
    """Lag of the mechanism behind the room, s."""
    offset_N: float = setting(4.0, low=0.0, high=1e3)
    """Size of the sensor's constant offset, N."""
    offset_Nm: float = setting(0.15, low=0.0, high=1e2)
    """Size of the sensor's constant torque offset, N m."""
    drift_N: float = setting(1.0, low=0.0, high=1e3)
    """Size of the sensor's warm-up, with 0.033 N m per N, N."""
    drift_time_s: float = setting(3600.0, low=1.0, high=1e6)
    """Time constant of the warm-up, s."""
    drift_wander: float = setting(0.02, low=0.0, high=10.0)
    """Slow random part as a share of the warm-up."""
    payload_mass_kg: float = setting(0.0, low=0.0, high=100.0)
    """Known load between sensor and mechanism, kg."""
    payload_centre_m: tuple[float, ...] = setting((0.03, 0.0, 0.0), low=-10.0, high=10.0)
    """Centre of the known load in the top frame, m."""
    marker_mass_kg: float = setting(0.0, low=0.0, high=10.0)
    """Mass of the target, also on the zeroed sensor, kg."""
    marker_centre_m: tuple[float, ...] = setting((0.01, 0.0, 0.04), low=-1.0, high=1.0)
    """Centre of the target in the top frame, m."""
    regulator_offset_Pa: float = setting(0.0, low=-1e6, high=1e6)
    """Zero of all pressure regulators, Pa."""
    regulator_gain: float = setting(0.0, low=-0.5, high=0.5)
    """Error of all regulators as a share of the largest pressure; it bends."""
    regulator_lag_s: float = setting(0.0, low=0.0, high=1e4)
    """Time constant in which a pressure follows, s."""
    regulator_step_Pa: float = setting(0.0, low=0.0, high=1e6)
    """Smallest step of a regulator, Pa; 0: none."""
    chamber_leak_per_s: float = setting(0.0, low=0.0, high=1.0)
    """Share of its pressure that each chamber loses in the first second, 1/s."""
    gravity_m_s2: tuple[float, ...] = setting((-9.81, 0.0, 0.0), low=-100.0, high=100.0)
    """Gravity in base axes, m/s^2."""


@dataclass(frozen=True)
class HiddenTable:
    """[hidden]: an effect put into the plant, its truth sealed; the flag --hide goes before it.

    Examples
    --------
    >>> HiddenTable(effect="hysteresis", strength=2.0).strength
    2.0
    """

    effect: str = setting("")
    """Id of a hidden effect, `random`, `none` (sealed), or empty for nothing."""
    strength: float = setting(1.0, low=1e-3, high=100.0)
    """Strength s, in standard deviations of the noise."""


@dataclass(frozen=True)
class RigSettings(Checked):
    """A whole rig file.

    Examples
    --------
    >>> rig = RigSettings.from_dict({"rig": {"dwell_s": 5.0}, "instrument": {"force_noise_N": 1.0}})
    >>> rig.rig.dwell_s, rig.instrument.force_noise_N
    (5.0, 1.0)
    """

    rig: Procedure = field(default_factory=Procedure)
    instrument: Instruments = field(default_factory=Instruments)
    plant: PlantTable = field(default_factory=PlantTable)
    hidden: HiddenTable = field(default_factory=HiddenTable)
    arm: ArmSettings = field(default_factory=ArmSettings)
    """Keys of [rig] that mode = "robot" adds."""

    def _check_together(self) -> None:
        quaternion = np.asarray(self.instrument.top_from_sensor[3:])
        if abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-6:
            raise InputError(
                f"[instrument] top_from_sensor: the quaternion (w, x, y, z) = "
                f"{tuple(quaternion.tolist())} has norm {np.linalg.norm(quaternion):.6g}, "
                "expected 1; give x y z then w x y z"
            )
        rate, images = self.rig.stream_Hz, self.instrument.camera_rate_Hz
        if rate and not LOWEST_STREAM_HZ <= rate <= images:
            raise InputError(
                f"[rig] stream_Hz = {rate:g}: a row of the raw stream is one image, expected "
                f"{LOWEST_STREAM_HZ:g} to [instrument] camera_rate_Hz = {images:g}, or 0 for no "
                "stream"
            )

    @staticmethod
    def from_dict(tables: Mapping[str, Any], where: str = "rig file") -> RigSettings:
        """The four tables of a parsed TOML; each may be absent.

        Raises
        ------
        InputError
            Naming file, table, key and the nearest known name.

        Examples
        --------
        >>> RigSettings.from_dict({"rig": {"dwell_s": 5.0}}).rig.dwell_s
        5.0
        """
        procedure = tables.get("rig", {})
        own, arm = procedure, dict[str, Any]()
        if isinstance(procedure, Mapping):
            own, arm = split_arm(procedure, where)
        if "mover" in tables:
            raise InputError(
                f"{where}: this is the file of a real rig, for ecm measure; expected that of a "
                f"simulated rig, with the tables {', '.join(TABLES)}",
                remedy=Remedy("write one, with the noise and the times of yours", "ecm new rig"),
            )
        check_keys(tables, TABLES, where)
        others = {"instrument": Instruments, "plant": PlantTable, "hidden": HiddenTable}
        settings = RigSettings(
            rig=read_settings(Procedure, own, f"{where} [rig]"),
            arm=read_settings(ArmSettings, arm, f"{where} [rig]"),
            **read_sections(others, tables, where),
        )
        if settings.hidden.effect:
            try:
                Hidden.parse(settings.hidden.effect)
            except InputError as error:
                raise InputError(f"{where} [hidden] effect: {error}") from None
        return settings

    def to_dict(self) -> dict[str, Any]:
        """Every setting, defaults included, as plain lists and numbers."""
        document: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        arm = document.pop("arm")
        if self.rig.mode == "robot":
            document["rig"] |= arm
        return document


def split_arm(table: Mapping[str, Any], where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """[rig] into the keys of every rig and those of the arm.

    Raises
    ------
    InputError
        A key of the arm where the mode is another.
    """
    arm_keys, own_keys = ([f.name for f in fields(kind)] for kind in (ArmSettings, Procedure))
    if table.get("mode") == "robot":
        check_keys(table, [*own_keys, *arm_keys, _RETIRED], f"{where} [rig]")
    if table.get(_RETIRED):
        raise InputError(
            f"{where} [rig] {_RETIRED}: faults are not rehearsed any more; take it out"
        )
    arm = {key: value for key, value in table.items() if key in arm_keys}
    if arm and table.get("mode") != "robot":
        raise InputError(
            f'{where} [rig] {next(iter(arm))}: only the arm has it; set mode = "robot", or take '
            "the key out"
        )
    return {k: value for k, value in table.items() if k not in (*arm_keys, _RETIRED)}, arm
