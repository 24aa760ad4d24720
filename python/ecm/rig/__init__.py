"""The simulated rig: a plant apart from the models that are identified from it.

Nothing here imports the catalogue of effects, the models or the diagnosis: the physics of the
plant has formulas of its own, or finding it would prove nothing.
"""

from __future__ import annotations

from ecm.rig.campaign import Campaign
from ecm.rig.elastic import SolvedPoses, Source
from ecm.rig.run import CampaignOptions, campaign_minutes, fem_source, run_campaign, run_campaigns
from ecm.rig.settings import HiddenTable, Instruments, PlantTable, Procedure, RigSettings
from ecm.rig.truth import Hidden, Revealed, reveal, score

rig_from_dict = RigSettings.from_dict

__all__ = [
    "Campaign",
    "CampaignOptions",
    "Hidden",
    "HiddenTable",
    "Instruments",
    "PlantTable",
    "Procedure",
    "Revealed",
    "RigSettings",
    "SolvedPoses",
    "Source",
    "campaign_minutes",
    "fem_source",
    "reveal",
    "rig_from_dict",
    "run_campaign",
    "run_campaigns",
    "score",
]
