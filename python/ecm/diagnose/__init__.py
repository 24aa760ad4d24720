"""Which physical effect is missing: rank, search, accept, and say what cannot be told."""

from ecm.diagnose.procedure import diagnose
from ecm.diagnose.verdict import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
