"""Which physical effect is missing: gate, rank, search, accept, verdict."""

from ecm.diagnosis.procedure import Stages, diagnose, find_missing, watched
from ecm.diagnosis.result import Diagnosis
from ecm.diagnosis.settings import DiagnosisSettings

__all__ = ["Diagnosis", "DiagnosisSettings", "Stages", "diagnose", "find_missing", "watched"]
