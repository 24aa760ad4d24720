"""Logs of other programs (CSV of any dialect, Parquet, MAT, NPZ, ROS bags) as tables."""

from ecm.logs.importing import ImportedLog, import_log

__all__ = ["ImportedLog", "import_log"]
