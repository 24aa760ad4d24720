"""A head on the neck, moved by four tendons: what an error of the model means in millimetres.

The plant (MuJoCo) knows the true neck; the controller knows a model that a campaign on the
simulated rig has identified, as the C code of `ecm export`, called once per millisecond.
"""

from __future__ import annotations
