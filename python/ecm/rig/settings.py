"""The rig file: tables [rig] [instrument] [plant] [hidden], each a frozen dataclass.

Every figure is a setting of the user, none is a vendor's. Instrument figures are per sample; the
campaign writes those of the averaged row into the measurement table.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.settings import read_settings, setting
from ecm.io.toml import check_keys, closest
from ecm.rig.arm.settings import ArmSettings
from ecm.rig.hidden.spec import Hidden

TABLES = ("rig", "instrument", "plant", "hidden")
LOWEST_STREAM_HZ = 0.1
"""Below it many a way is passed without a sample."""


@dataclass(frozen=True)
class Procedure:
    """[rig]: how the poses are visited and how long that takes."""

    mode: str = setting("quasi_static", choices=("quasi_static", "robot"))
    """A source of poses that rest in each window, or the arm with its dynamics (`ecm.rig.arm`)."""
    approach: str = setting("initial", choices=("initial", "previous"))
    """Where a pose is driven from when the plan has no `approach`: home, or the pose before."""
    dwell_s: float = setting(2.0, low=0.0, high=1e5)
    """Rest before the window where the plan has no `dwell_s`."""
    window_s: float = setting(0.2, low=1e-3, high=1e3)
    """Readings are averaged over this window."""
    speed_m_s: float = setting(0.02, low=1e-5, high=10.0)
    speed_rad_s: float = setting(0.15, low=1e-4, high=100.0)
    """Peak speed of the cubic timing law, of translation and rotation."""
    pose_error_m: float = setting(1.5e-4, low=0.0, high=5e-3)
    pose_error_rad: float = setting(1e-3, low=0.0, high=0.05)
    """Standard deviation of the reached minus the commanded pose, per axis."""
    offset_compensation: str = setting(
        "linear", choices=("linear", "before", "none", "temperature")
    )
    """`linear` in time between the unloaded readings before and after; `before`: the last one;
    `temperature`: a line in the sensor's temperature and time, then `linear` on what is left."""
    offset_every: int = setting(50, low=0, high=1_000_000)
    """Poses between two unloaded readings; 0: only before the first and after the last pose."""
    offset_window_s: float = setting(60.0, low=1e-2, high=1e5)
    """An unloaded reading is averaged over this time."""
    unload_s: float = setting(60.0, low=0.0, high=1e5)
    """Time to free the sensor, and to connect it again."""
    handling_s: float = setting(600.0, low=0.0, high=1e6)
    """Time of a remount, of a payload taken off, of a dead weight."""
    stream_Hz: float = setting(0.0, low=0.0, high=1e4)
    """Samples a second of the raw stream while the arm moves, NAME.raw.parquet; 0: none. One is
    an image, so camera_rate_Hz at most, and 0.1 at least."""
    rotation_limit_rad: float = setting(1.5, low=0.0, high=3.1)
    stretch_limit: float = setting(0.8, low=0.0, high=10.0)
    """Limit of |r - r0| over the length of the mechanism; poses outside are skipped."""


@dataclass(frozen=True)
class Instruments:
    """[instrument]: force-torque sensor, camera, thermometers; figures of one sample."""

    force_noise_N: float = setting(3.0, low=0.0, high=1e4)
    torque_noise_Nm: float = setting(0.1, low=0.0, high=1e3)
    """White, each axis of the sensor's own frame."""
    force_noise_per_load: float = setting(0.0, low=0.0, high=1.0)
    """Noise that grows with the load: a share of each axis's reading, added in squares."""
    fts_rate_Hz: float = setting(500.0, low=1.0, high=1e6)
    fts_range: tuple[float, ...] = setting((400.0, 200.0, 200.0, 20.0, 20.0, 20.0), low=1e-9)
    """A reading beyond is clipped, axis by axis of the sensor."""
    fts_resolution: tuple[float, ...] = setting((0.1, 0.05, 0.05, 5e-3, 5e-3, 5e-3), low=0.0)
    """One count; 0: none."""
    fts_gain: tuple[float, ...] = setting((1.0,) * 6, low=0.1, high=10.0)
    """Reading over true wrench of each axis."""
    fts_crosstalk: tuple[float, ...] = setting((0.0,) * 36, low=-100.0, high=100.0)
    """Row by row: what axis i reads of one N or N m on axis j; the diagonal is the gain's."""
    fts_thermal_per_K: tuple[float, ...] = setting((0.0,) * 6, low=-100.0, high=100.0)
    """Drift of each axis's zero with the sensor's own temperature, N/K and N m/K."""
    top_from_sensor: tuple[float, ...] = setting(
        (0.01, 0.0, 0.0, 0.9659258262890683, 0.25881904510252074, 0.0, 0.0), low=-10.0, high=10.0
    )
    """Sensor frame in the top frame: position in m, unit quaternion w x y z."""
    frames: str = setting("known", choices=("known", "calibrated"))
    """`calibrated`: both targets and the sensor sit where a calibration with these instruments
    finds them, a little off; `known`: where they are."""
    zeroed_with_payload: bool = setting(False)
    """The sensor was zeroed with the payload hanging on it, at the rest pose."""
    camera_rate_Hz: float = setting(60.0, low=1.0, high=1e5)
    camera_error_m: float = setting(37e-6, low=0.0, high=0.1)
    camera_error_rad: float = setting(4e-4, low=0.0, high=0.5)
    """Error of localisation that all LEDs share: constant while the target rests, so a window
    does not average it out; new at each visit."""
    led_errors: str = setting("common", choices=("common", "independent"))
    """`common`: all LEDs of a target share the error above; `independent`: each LED has an error
    of camera_error_m of its own, and the pose is that of the rigid fit."""
    camera_place_m: tuple[float, ...] = setting((0.1, 0.5, 1.4), low=-100.0, high=100.0)
    """Middle of the three lenses, base axes."""
    lens_spread_m: float = setting(0.3, low=0.0, high=10.0)
    """From one lens to the next."""
    led_radius_m: float = setting(0.05, low=1e-3, high=1.0)
    """Of the dome that carries the nine LEDs."""
    led_angle_rad: float = setting(0.9, low=0.05, high=3.1)
    """An LED is seen within this angle of its direction; at 0.9 four or more are, up to a tilt of
    0.8 rad."""
    camera_drift_m: float = setting(0.0, low=0.0, high=0.1)
    camera_drift_rad: float = setting(0.0, low=0.0, high=0.5)
    """Slow motion of the camera on its stand (Ornstein-Uhlenbeck, 1 h), per axis."""
    base_target: bool = setting(True)
    """A second target at the base shows the camera's motion, which is taken off."""
    base_target_images: int = setting(600, low=1, high=1_000_000)
    """Images of the base target that are averaged."""
    clock_skew: float = setting(0.0, low=-0.1, high=0.1)
    """The recorder's clock runs fast by this share."""
    time_stamp_sd_s: float = setting(0.0, low=0.0, high=10.0)
    """Scatter of a row's time stamp."""
    camera_jitter_m: float = setting(2e-5, low=0.0, high=0.1)
    camera_jitter_rad: float = setting(1e-4, low=0.0, high=0.5)
    """White from image to image."""
    outlier_share: float = setting(0.0, low=0.0, high=0.5)
    """Share of windows in which an LED is mistaken."""
    outlier_scale: float = setting(8.0, low=1.0, high=1e3)
    """Such a window's localisation error over the usual one."""
    thermometer_noise_degC: float = setting(0.05, low=0.0, high=100.0)
    thermometer_lag_s: float = setting(60.0, low=0.0, high=1e5)
    """Of the probe behind the mechanism's mean temperature."""


@dataclass(frozen=True)
class PlantTable:
    """[plant]: the true surroundings of the mechanism. Its own material is `[mechanism]`."""

    room_temperature_degC: float = setting(22.0, low=-50.0, high=100.0)
    room_cycle_degC: float = setting(1.5, low=0.0, high=50.0)
    """Amplitude of the heating's cycle."""
    room_cycle_s: float = setting(2700.0, low=1.0, high=1e6)
    room_wander_degC: float = setting(0.7, low=0.0, high=50.0)
    """Standard deviation of a slow random part (Ornstein-Uhlenbeck, 1 h)."""
    thermal_lag_s: float = setting(600.0, low=1.0, high=1e6)
    """The mechanism's mean temperature behind the room's."""
    offset_N: float = setting(4.0, low=0.0, high=1e3)
    offset_Nm: float = setting(0.15, low=0.0, high=1e2)
    """Size of the sensor's constant offset, drawn by the seed."""
    drift_N: float = setting(1.0, low=0.0, high=1e3)
    """Size of the sensor's warm-up, with 0.033 N m per N; its direction is drawn by the seed and
    the compensation sees it."""
    drift_time_s: float = setting(3600.0, low=1.0, high=1e6)
    """Time constant of the warm-up."""
    drift_wander: float = setting(0.02, low=0.0, high=10.0)
    """Slow random part as a share of the warm-up (Ornstein-Uhlenbeck, 1 h)."""
    payload_mass_kg: float = setting(0.0, low=0.0, high=100.0)
    payload_centre_m: tuple[float, ...] = setting((0.03, 0.0, 0.0), low=-10.0, high=10.0)
    """Known load between sensor and mechanism, in the top frame; declared in the data."""
    marker_mass_kg: float = setting(0.0, low=0.0, high=10.0)
    """Of the target between sensor and mechanism: it hangs on the sensor at every zero as well."""
    marker_centre_m: tuple[float, ...] = setting((0.01, 0.0, 0.04), low=-1.0, high=1.0)
    """In the top frame."""
    gravity_m_s2: tuple[float, ...] = setting((-9.81, 0.0, 0.0), low=-100.0, high=100.0)
    """In base axes."""


@dataclass(frozen=True)
class HiddenTable:
    """[hidden]: an effect put into the plant, its truth sealed; the flag --hide goes before it."""

    effect: str = setting("")
    """An id of the catalogue, `random`, `none` (sealed), or empty for nothing."""
    strength: float = setting(1.0, low=1e-3, high=100.0)
    """s: root mean square of the whitened effect after projecting out the base."""


@dataclass(frozen=True)
class RigSettings:
    """A whole rig file."""

    rig: Procedure = field(default_factory=Procedure)
    instrument: Instruments = field(default_factory=Instruments)
    plant: PlantTable = field(default_factory=PlantTable)
    hidden: HiddenTable = field(default_factory=HiddenTable)
    arm: ArmSettings = field(default_factory=ArmSettings)
    """Keys of [rig] that mode = "robot" adds."""

    def __post_init__(self) -> None:
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
        """
        procedure = tables.get("rig", {})
        own, arm = procedure, dict[str, Any]()
        if isinstance(procedure, Mapping):
            own, arm = split_arm(procedure, where)
        check_keys(tables, TABLES, where)
        settings = RigSettings(
            rig=read_settings(Procedure, own, f"{where} [rig]"),
            arm=read_settings(ArmSettings, arm, f"{where} [rig]"),
            instrument=read_settings(
                Instruments, tables.get("instrument", {}), f"{where} [instrument]"
            ),
            plant=read_settings(PlantTable, tables.get("plant", {}), f"{where} [plant]"),
            hidden=read_settings(HiddenTable, tables.get("hidden", {}), f"{where} [hidden]"),
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
    arm_keys = {f.name for f in fields(ArmSettings)}
    own_keys = {f.name for f in fields(Procedure)}
    if table.get("mode") == "robot":
        # A misspelt key goes where the likely name is known, which tells it.
        for key in set(table) - arm_keys - own_keys:
            arm_keys |= {key} if closest(key, [*own_keys, *arm_keys]) in arm_keys else set()
    arm = {key: value for key, value in table.items() if key in arm_keys}
    if arm and table.get("mode") != "robot":
        raise InputError(
            f'{where} [rig] {next(iter(arm))}: only the arm has it; set mode = "robot", or take '
            "the key out"
        )
    return {key: value for key, value in table.items() if key not in arm_keys}, arm
