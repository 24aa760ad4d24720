"""The simulated rig: a plant apart from the models that are identified from it.

Nothing here imports the catalogue of effects, the models or the diagnosis: the physics of the
plant has formulas of its own, or finding it would prove nothing.
"""

from __future__ import annotations

from ecm.rig.settings import HiddenTable, Instruments, PlantTable, Procedure, RigSettings

__all__ = ["HiddenTable", "Instruments", "PlantTable", "Procedure", "RigSettings"]
