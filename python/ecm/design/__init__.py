"""Step 2 of the paper: the poses worth measuring, and the plan in which a rig visits them.

`choose` finds rows of a candidate table through the same Rust code as the binary `ecm-design`.
`plain_plan`, `paper_plan` and `diagnosable_plan` make a campaign of them. `separable` says which
effects a plan can name and from what size, `how_many` what further poses would bring.
"""

from ecm.design.base import BaseForDesign, nominal_base, rig_noise
from ecm.design.choose import Design, choose
from ecm.design.follow_up import drivable, follow_up_plan
from ecm.design.how_many import Size, how_many
from ecm.design.plans import DWELLS_S, diagnosable_plan, paper_plan, plain_plan
from ecm.design.regressors import polynomial_degree
from ecm.design.separable import Separable, predicted_table, separable

__all__ = [
    "DWELLS_S",
    "BaseForDesign",
    "Design",
    "Separable",
    "Size",
    "choose",
    "diagnosable_plan",
    "drivable",
    "follow_up_plan",
    "how_many",
    "nominal_base",
    "paper_plan",
    "plain_plan",
    "polynomial_degree",
    "predicted_table",
    "rig_noise",
    "separable",
]
