"""Commented files to begin from; `ecm new` writes them, and each is valid as it stands."""

from __future__ import annotations

CONFIG = """\
# The neck of the paper, from mesh to report, at real size:
#   ecm identify config.toml --out DIR

[mechanism]                 # a clamped cylinder of soft silicone
builtin = "cylinder"
length_m = 0.1034
radius_m = 0.033
young_modulus_Pa = 0.65e6
poisson_ratio = 0.49

[workspace]                 # which poses are admissible, and the wrenches that are drawn
rotation_limit_rad = 0.8
stretch_limit = 2.5
wrench_min = [-110.0, -100.0, -100.0, -5.0, -5.0, -5.0]   # fx fy fz N, taux tauy tauz N m
wrench_max = [30.0, 100.0, 100.0, 5.0, 5.0, 5.0]

[simulate]
n = 1700                    # wrench-pose pairs by FEM
n_test = 300                # of these, only for testing

[select]
degrees = [1, 2, 3]
thresholds = [0.0, 0.1, 0.5]
energy_degrees = [4, 6]
energy_poses = [20, 50, 200]

[design]
n = 200                     # poses in each design, D-optimal and maximin
starts = 10

[rig]                       # the simulated rig; `ecm new rig` shows more keys
mode = "quasi_static"

[hidden]                    # the loop at the end: found again by diagnose
effect = "base_compliance"
strength = 1.0
"""

RIG = """\
# A simulated rig:  ecm campaign plan.csv --rig rig.toml --out data.csv
# Figures are per sample; the campaign writes those of the averaged row into the table.

[rig]
mode = "quasi_static"             # or "robot": the arm with its dynamics (docs/robot.md)
approach = "initial"              # from home; or "previous", from the pose before
dwell_s = 2.0                     # rest before the reading, where the plan says nothing
window_s = 0.2                    # readings are averaged over this time
offset_compensation = "linear"    # of the sensor, between unloaded readings before and after
offset_every = 50                 # poses between two unloaded readings

[instrument]
force_noise_N = 3.0
torque_noise_Nm = 0.1
fts_rate_Hz = 500.0
fts_range = [400.0, 200.0, 200.0, 20.0, 20.0, 20.0]
camera_error_m = 37e-6
camera_error_rad = 4e-4

[plant]
room_temperature_degC = 22.0
gravity_m_s2 = [-9.81, 0.0, 0.0]
payload_mass_kg = 0.0

[hidden]                          # an id of `ecm effects`, "random", or "" for nothing
effect = ""
strength = 1.0
"""

DATA_CSV = """\
pose_id,time_s,x_m,y_m,z_m,theta_x_rad,theta_y_rad,theta_z_rad,fx_N,fy_N,fz_N,tau_x_Nm,tau_y_Nm,tau_z_Nm
0,12.5,0.1034,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0
1,48.2,0.1031,0.0062,0.0,0.0,0.0,0.1,-4.1,3.6,0.0,0.0,0.0,0.49
"""

DATA_TOML = """\
# Describes data.csv. Every key may be left out; an unknown one is an error.

[file]
kind = "static"               # or "continuous"
header_rows = 1               # 0, 1 or 2

[columns]                     # standard name = scale * own + offset; own by name or number
# fx_N = { column = "Fx [kN]", scale = 1e3 }
# theta_x_rad = { column = 7, scale = 0.017453292519943295 }
# group = ["load_x"]          # rows that stay together in held-out splits

[mechanism]                   # length_m alone suffices for energy models
length_m = 0.1034
# builtin = "cylinder"        # with these the physics model can be fitted
# radius_m = 0.033
# young_modulus_Pa = 0.65e6
# poisson_ratio = 0.49

[instrument]                  # one row's noise after averaging
pose_position_sd_m = 4e-5
pose_rotation_sd_rad = 4e-4
force_sd_N = 0.3
torque_sd_Nm = 0.01

[scene]
gravity_m_s2 = [-9.81, 0.0, 0.0]   # in base axes

# [run.1]                     # what was different in run 1 of the column `run`
# payload_mass_kg = 0.0
"""

TEXTS = {"config": CONFIG, "rig": RIG, "data": DATA_CSV}

NEXT = {
    "config": "Next: ecm identify {path} --out DIR",
    "rig": "Next: ecm campaign PLAN.csv --rig {path} --out data.csv",
    "data": "Next: put your rows in, then: ecm check {path}",
}
