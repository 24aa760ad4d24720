"""A soft IOC of EPICS: six motors in mm and degrees that carry a spring, its sensor, a camera.

    python soft_ioc.py PORT

prints `ready` once the first motor is at 100 mm. `push` is added to the wrench; `hold` stops the
sensor's scan.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np
from caproto import AlarmSeverity
from caproto.ioc_examples.fake_motor_record import FakeMotor
from caproto.server import PVGroup, SubGroup, pvproperty, run

AXES = ("x", "y", "z", "rx", "ry", "rz")
REST = np.array([100.0, 0.0, 0.0, 0.0, 0.0, 0.0])
SCALE = np.array([1e-3] * 3 + [np.pi / 180.0] * 3)
STIFFNESS = np.array([2000.0, 1000.0, 1000.0, 2.0, 3.0, 3.0])


class Rig(PVGroup):
    """Process variables `rig:...`."""

    x, y, z, rx, ry, rz = (
        SubGroup(FakeMotor, velocity=40.0, user_limits=(-200.0, 200.0), tick_rate_hz=25.0, prefix=p)
        for p in AXES
    )
    wrench = pvproperty(value=[0.0] * 6, max_length=6, alarm_group="sensor")
    pose = pvproperty(value=[0.0] * 6, max_length=6)
    temperature = pvproperty(value=22.5)
    push = pvproperty(value=0.0)
    hold = pvproperty(value=0)
    trust = pvproperty(value=1)
    pressure = pvproperty(value=[0.0, 0.0], max_length=2)
    gauge = pvproperty(value=[0.0, 0.0], max_length=2)

    @wrench.startup
    async def wrench(self, instance: Any, async_lib: Any) -> None:
        """Scan the sensor and the camera fifty times a second."""
        random = np.random.default_rng(0)
        motors = [getattr(self, axis).motor for axis in AXES]
        await async_lib.library.sleep(0.1)
        await motors[0].write(REST[0])
        ready = False
        while True:
            at = np.array([motor.field_inst.user_readback_value.value for motor in motors])
            if not ready and abs(at[0] - REST[0]) < 1e-9:
                ready = True
                print("ready", flush=True)
            if not self.hold.value:
                noise = 0.01 * random.standard_normal(6)
                wrench = STIFFNESS * SCALE * (at - REST) + self.push.value + noise
                severity = (
                    AlarmSeverity.NO_ALARM if self.trust.value else AlarmSeverity.INVALID_ALARM
                )
                await instance.alarm.write(severity=severity)
                await instance.write(wrench.tolist())
                await self.pose.write((at + 1e-3 * random.standard_normal(6)).tolist())
                await self.gauge.write((0.98 * np.asarray(self.pressure.value)).tolist())
            await async_lib.library.sleep(0.02)


if __name__ == "__main__":
    os.environ["EPICS_CA_SERVER_PORT"] = sys.argv[1]
    os.environ["EPICS_CAS_AUTO_BEACON_ADDR_LIST"] = "NO"
    os.environ["EPICS_CAS_BEACON_ADDR_LIST"] = "127.0.0.1"
    run(Rig(prefix="rig:").pvdb, interfaces=["127.0.0.1"], log_pv_names=False)
