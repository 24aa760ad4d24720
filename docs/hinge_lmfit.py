"""The hinge of README.md with lmfit (python -m pip install lmfit): docs/explain/beside_lmfit.md.

Each physics that may be missing is a function that one writes; lmfit fits it and gives its BIC.
"""

from pathlib import Path

import lmfit
import numpy as np

LOG = Path(__file__).parents[1] / "examples" / "hinge_log.csv"
NOISE_NMM = 3.0
time, degrees, torque = np.loadtxt(LOG, delimiter=",", skiprows=1, unpack=True)
angle = np.deg2rad(degrees)
speed = np.gradient(angle, time)


def cubic(p):
    return p["c0"] + p["c1"] * angle + p["c2"] * angle**2 + p["c3"] * angle**3


def friction(p):  # a spring that slips: what sticks is limited
    force = np.zeros(len(angle))
    for i in range(1, len(angle)):
        step = p["hold"] / p["slip"] * (angle[i] - angle[i - 1])
        force[i] = np.clip(force[i - 1] + step, -p["hold"], p["hold"])
    return cubic(p) + force


def damping(p):
    return cubic(p) + p["damping"] * speed


def relaxation(p):  # one branch, exact for straight pieces
    branch, fades = np.zeros(len(angle)), np.exp(-np.diff(time) / p["tau"])
    for i in range(1, len(angle)):
        rate = (angle[i] - angle[i - 1]) / (time[i] - time[i - 1])
        branch[i] = fades[i - 1] * branch[i - 1] + p["k"] * p["tau"] * (1 - fades[i - 1]) * rate
    return cubic(p) + branch


def drift(p):
    return cubic(p) + p["rate"] * time


START = {
    cubic: {},
    friction: {"hold": (10, 0, 1e3), "slip": (0.01, 1e-3, 0.2)},
    damping: {"damping": (1, 0, 1e5)},
    relaxation: {"k": (100, 0, 1e5), "tau": (1, 0.05, 100)},
    drift: {"rate": (0, -1e3, 1e3)},
}
"""First value and bounds of what each adds to the cubic."""


def held_out(model, parameters):
    """Error over noise on ten stretches that the fit did not see."""
    left = np.zeros(len(angle))
    for part in np.array_split(np.arange(len(angle)), 10):
        seen = np.setdiff1d(np.arange(len(angle)), part)
        found = lmfit.minimize(lambda p, rows=seen: (model(p) - torque)[rows], parameters)
        left[part] = (model(found.params) - torque)[part]
    return np.sqrt(np.mean(left**2)) / NOISE_NMM


for model, more in START.items():
    parameters = lmfit.create_params(c0=0, c1=1000, c2=0, c3=0)
    for name, (value, low, high) in more.items():
        parameters.add(name, value, min=low, max=high)
    fit = lmfit.minimize(lambda p, m=model: (m(p) - torque) / NOISE_NMM, parameters)
    error = np.sqrt(np.mean(fit.residual**2))
    told = ", ".join(f"{n} {fit.params[n].value:.3g}" for n in more)
    held = held_out(model, parameters)
    errors = f"{error:5.2f} fitted {held:6.2f} held out  BIC {fit.bic:6.0f}"
    print(f"{model.__name__:10} {errors}  {told}")
