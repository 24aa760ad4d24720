# %% [markdown]
# # Notebook: from a table to a model
#
# Forty poses of a silicone neck were measured twice each. This notebook looks at the table, fits
# three models, and asks which of them is good enough. It begins in the repository's folder:
# `examples/neck_measured.csv` is the table, `examples/neck_measured.toml` its description.

# %%
import numpy as np

import ecm

table = ecm.read_table("examples/neck_measured.csv")
poses = table.select(np.flatnonzero(table.text("kind") == "pose"))
print(f"{len(table)} rows, of them {len(poses)} at poses; the rest are at home or unloaded")
for name in ("y_m", "theta_z_rad", "fy_N", "tau_z_Nm"):
    values = poses.column(name)
    print(f"{name:12} from {values.min():7.3f} to {values.max():7.3f}")

# %% [markdown]
# The neck was bent by up to 0.7 rad, that is 40 degrees. `ecm.check` says the same for all
# columns, and which effects these columns can show.

# %%
checked = ecm.check(table)
print(f"{checked.repeated_poses} poses were visited again")
print(f"{len(checked.testable)} effects can be tested")

# %% [markdown]
# ## Three models
#
# A linear model has one matrix of stiffness. The energies are polynomials of degree 4 and 5 that
# respect the symmetry of a round body (see *Why symmetric energies*). Each is judged on rows that
# its fit has not seen.

# %%
for name in ("linear", "energy4", "energy5"):
    held_out = ecm.cross_validate(table, name, folds=5)
    print(
        f"{name:8} held-out error: fy {held_out.rmse['fy_N']:5.2f} N, "
        f"tau_z {1e3 * held_out.rmse['tau_z_Nm']:6.1f} mN m"
    )

# %% [markdown]
# The sensor's noise is 0.3 N and 10 mN m, and the noise of the measured pose adds to it. The
# energies are near that; the linear model is far from it.
#
# ## The stiffness at a pose
#
# K is 6 x 6: how each component of the wrench changes with each coordinate of the pose.

# %%
model = ecm.fit(table, "energy4")
at_rest = np.array([0.1034, 0.0, 0.0, 0.0, 0.0, 0.0])
bent = poses.poses[np.argmax(np.abs(poses.column("theta_z_rad")))]
for words, pose in (("at rest", at_rest), ("most bent", bent)):
    K = model.stiffness(pose)
    print(f"{words:9} K(x, x) = {K[0, 0] / 1e3:5.1f} N/mm, K(y, y) = {K[1, 1] / 1e3:4.1f} N/mm")

# %% [markdown]
# The bent neck is softer along x and stiffer across. A controller that uses the stiffness at rest
# would be wrong by that much.
