"""A model for controllers and simulators: one file per target, and their registry."""

from ecm.models.export.files import TARGETS, export, export_files
from ecm.models.export.source import Exported

__all__ = ["TARGETS", "Exported", "export", "export_files"]
