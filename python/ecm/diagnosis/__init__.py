"""Which physical effect is missing: rank, search, accept, and say what cannot be told."""

from ecm.diagnosis.procedure import diagnose
from ecm.diagnosis.verdict import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
