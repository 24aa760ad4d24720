"""The hinge of README.md with MuJoCo's system identification: docs/explain/beside_lmfit.md.

The measured angle drives a stiff servo, and joint parameters are fitted until its torque follows
the measured one (python -m pip install "mujoco[sysid]!=4.0.0").
"""

from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid

LOG = Path(__file__).parents[1] / "examples" / "hinge_log.csv"
NOISE_NM = 3e-3
time, degrees, torque = np.loadtxt(LOG, delimiter=",", skiprows=1, unpack=True)
BODY = '<body><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>'
HINGE = f"""<mujoco>
  <option timestep="1e-3" integrator="implicitfast"><flag gravity="disable"/></option>
  <worldbody>
    {BODY}<joint name="hinge" axis="0 0 1"/></body>
    {BODY}<joint name="slider" axis="0 0 1"/></body>
  </worldbody>
  <tendon><fixed name="link" springlength="0">
    <joint joint="hinge" coef="1"/><joint joint="slider" coef="-1"/>
  </fixed></tendon>
  <actuator><position name="servo" joint="hinge" kp="1e4" kv="10"/></actuator>
  <sensor><actuatorfrc name="torque" actuator="servo"/></sensor>
</mujoco>"""


def spring(spec, k):  # k1 q + k2 q^2 + k3 q^3, with an angle of rest
    spec.joint("hinge").stiffness, spec.joint("hinge").springref = k[:3], k[3]


def damping(spec, k):
    spec.joint("hinge").damping = [k[0], 0, 0]


def friction(spec, k):
    spec.joint("hinge").frictionloss = k[0]


def slip(spec, k):  # a spring to a second body that rubs
    spec.joint("slider").frictionloss = k[0]
    spec.tendon("link").stiffness = [k[0] / k[1], 0, 0]


CUBIC = (spring, [1, 0.1, 0.1, 0.01], [0, -50, -50, -1], [50, 50, 50, 1])
MORE = {
    "cubic": [],
    "damping": [(damping, [0.01], [0], [10])],
    "friction": [(friction, [0.01], [0], [10])],
    "slip": [(slip, [0.01, 0.02], [1e-4, 1e-3], [1, 1])],
}
"""Name, first values, lower and upper bounds of what each adds to the cubic."""

for name, more in MORE.items():
    spec = mujoco.MjSpec.from_string(HINGE)  # of its own: a fit changes it
    model = spec.compile()
    begin = sysid.create_initial_state(model, np.zeros(2))
    angle = sysid.TimeSeries.from_control_names(time, np.deg2rad(degrees)[:, None], model)
    seen = sysid.TimeSeries.from_names(time, torque[:, None] / 1e3, model)
    log = sysid.ModelSequences("hinge", spec, "log", begin, angle, seen)
    parameters = sysid.ParameterDict()
    for write, *values in [CUBIC, *more]:
        modifier = lambda spec, p, write=write: write(spec, p.value)  # noqa: E731
        parameters.add(sysid.Parameter(write.__name__, *values, modifier=modifier))
    residual = sysid.build_residual_fn(models_sequences=[log])
    found, _ = sysid.optimize(parameters, residual, verbose=False)
    _, modelled, seen = residual(found.as_vector(), found, return_pred_all=True)
    error = np.sqrt(np.mean((modelled[0][0].data - seen[0][0].data) ** 2)) / NOISE_NM
    print(f"{name:10} {error:5.2f} fitted  {found.as_vector().round(4)}")
