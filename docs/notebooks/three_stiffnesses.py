# %% [markdown]
# # Notebook: three stiffnesses, and energy that is kept
#
# *The mechanics* derives two facts. Here they are checked by numbers, on a model that was fitted
# to measurements: the generalised stiffness H of an energy is symmetric, and the screw stiffness
# K_s is not, by exactly the moment.

# %%
import numpy as np

import ecm

table = ecm.read_table("examples/neck_measured.csv")
energy = ecm.fit(table, "energy4")
line = ecm.fit(table, "linear")
pose = np.array([0.100, 0.010, -0.005, 0.05, 0.1, 0.3])

# %% [markdown]
# K is the derivative of the wrench. Central differences show it:

# %%
step = 1e-6
differences = np.column_stack(
    [
        (energy.predict(pose + step * e) - energy.predict(pose - step * e)).ravel() / (2 * step)
        for e in np.eye(6)
    ]
)
K = energy.stiffness(pose)
print(f"largest difference of K: {np.abs(differences - K).max() / np.abs(K).max():.0e}")
assert np.allclose(differences, K, atol=1e-5 * np.abs(K).max())

# %% [markdown]
# H is symmetric for the energy, whatever the data were. For the linear model it is not: nothing
# asks it to be.

# %%
for name, model in (("energy4", energy), ("linear", line)):
    H = model.stiffness(pose, kind="generalised")
    print(f"{name:8} skew part of H over H: {np.abs(H - H.T).max() / np.abs(H).max():.0e}")

# %% [markdown]
# The rotation block of K_s - K_s' is minus the cross-product matrix of the moment. It is
# geometry, not an error of the model.

# %%
K_s = energy.stiffness(pose, kind="screw")
tx, ty, tz = energy.predict(pose).ravel()[3:]
cross = np.array([[0, -tz, ty], [tz, 0, -tx], [-ty, tx, 0]])
rest = (K_s - K_s.T)[3:, 3:] + cross
print(f"moment {np.linalg.norm([tx, ty, tz]):.2f} N m, left over {np.abs(rest).max():.0e} N m")
assert np.abs(rest).max() < 1e-9

# %% [markdown]
# ## A closed loop
#
# Push the platform along a small circle, back to where it began, and add up the work f dr + tau
# dphi. A body that stores energy gives back all of it. A model that is no energy does not: a
# controller that believed it could be pumped.

# %%
turn = np.linspace(0.0, 2.0 * np.pi, 401)
circle = np.tile(np.array([0.102, 0.0, 0.0, 0.0, 0.0, 0.0]), (401, 1))
circle[:, 1] += 0.01 * np.cos(turn)
circle[:, 5] += 0.20 * np.sin(turn)
for name, model in (("energy4", energy), ("linear", line)):
    h = model.predict(circle)
    middle, moved = (h[1:] + h[:-1]) / 2, np.diff(circle, axis=0)
    work = float((middle * moved).sum())  # the axis of the rotation does not change here
    print(f"{name:8} work of one turn {1e3 * work:8.4f} mJ")
