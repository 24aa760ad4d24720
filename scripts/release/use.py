"""A small use of the installed package: FEM, a fit, a prediction, a model file.

The figures are those of every machine to the digits that are printed; `release.check` compares.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import ecm

neck = ecm.Mechanism()
pairs = ecm.simulate(neck, 6, seed=1).table()
model = ecm.fit(pairs, "energy4")
error = np.abs(model.predict(pairs.poses) - pairs.wrenches)
stiffness = model.stiffness(pairs.poses[:1])[0]
model.save("neck.json")
again = ecm.load_model("neck.json")
if not np.array_equal(again.stiffness(pairs.poses), model.stiffness(pairs.poses)):
    sys.exit("the model that was read differs from the one that was written")
Path("neck.json").unlink()
print(f"K(x, x) = {stiffness[0, 0]:.2f} N/m, K(y, theta_z) = {stiffness[1, 5]:.4f} N")
print(f"largest error of fx {error[:, 0].max():.4f} N, of ty {error[:, 4].max():.6f} N m")
