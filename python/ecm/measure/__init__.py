"""From a plan to a table on a real rig: devices, limits, and a run that nothing can spoil."""

from ecm.measure.bench import Bench, DeviceTable, LimitsTable
from ecm.measure.devices import Device, device_kinds, opened
from ecm.measure.run import measure

__all__ = ["Bench", "Device", "DeviceTable", "LimitsTable", "device_kinds", "measure", "opened"]
