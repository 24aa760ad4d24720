"""From a plan to a table on a real rig: devices, limits, and a run that nothing can spoil."""

from ecm.bench.devices import Device, device_kinds, opened
from ecm.bench.run import measure
from ecm.bench.settings import Bench, DeviceTable, LimitsTable

__all__ = ["Bench", "Device", "DeviceTable", "LimitsTable", "device_kinds", "measure", "opened"]
