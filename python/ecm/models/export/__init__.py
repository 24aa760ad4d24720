"""A model for controllers and simulators: one file per target, and their registry."""

from ecm.models.export.files import TARGETS, Exported, export, export_files

__all__ = ["TARGETS", "Exported", "export", "export_files"]
