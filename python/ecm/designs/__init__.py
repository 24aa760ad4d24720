"""Step 2 of the paper: the poses worth measuring, and the plan in which a rig visits them.

`optimal_design` chooses rows of a candidate table with the Rust code of the binary `ecm-design`.
`plain_plan`, `paper_plan` and `diagnosable_plan` turn them into a plan, `follow_up_plan` plans a
proposed experiment, and `design_sizes` shows the error against the number of poses.
"""

from ecm.designs.optimal import Design, Size, design_sizes, optimal_design
from ecm.designs.plans import (
    DWELLS_S,
    can_be_run,
    diagnosable_plan,
    follow_up_plan,
    offsets_from_free,
    paper_plan,
    plain_plan,
)
from ecm.designs.regressors import (
    CRITERIA,
    DesignSettings,
    NominalModel,
    nominal_model,
    polynomial_degree,
    rig_noise,
)

__all__ = [
    "CRITERIA",
    "DWELLS_S",
    "Design",
    "DesignSettings",
    "NominalModel",
    "Size",
    "can_be_run",
    "design_sizes",
    "diagnosable_plan",
    "follow_up_plan",
    "nominal_model",
    "offsets_from_free",
    "optimal_design",
    "paper_plan",
    "plain_plan",
    "polynomial_degree",
    "rig_noise",
]
