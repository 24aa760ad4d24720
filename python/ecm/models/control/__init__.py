"""A control loop that holds a platform at a pose: its design, and its example code."""

from __future__ import annotations

from ecm.models.control.design import ControlLoop, LoopSettings, design_loop

__all__ = ["ControlLoop", "LoopSettings", "design_loop"]
