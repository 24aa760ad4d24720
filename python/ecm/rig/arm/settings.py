"""Settings of the arm: the keys of `[rig]` that only `mode = "robot"` has."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.io.settings import setting


@dataclass(frozen=True)
class ArmSettings:
    """Controllers, limits and scene of the simulated arm."""

    step_s: float = setting(
        1e-3, low=1e-5, high=2e-3, doc="Time step of the simulation and of the controllers, s."
    )
    impedance_N_m: float = setting(
        5000.0, low=10.0, high=5000.0, doc="Stiffness of the impedance control, each axis, N/m."
    )
    impedance_Nm_rad: float = setting(
        300.0, low=1.0, high=300.0, doc="Stiffness of the impedance control, each axis, N m/rad."
    )
    damping_ratio: float = setting(
        0.7, low=0.05, high=2.0, doc="Damping ratio of each mode of arm, controller and mechanism."
    )
    nullspace_Nm_rad: float = setting(
        50.0, low=0.0, high=500.0, doc="Stiffness that keeps the elbow as at home, N m/rad."
    )
    joint_stiffness_Nm_rad: float = setting(
        30000.0, low=100.0, high=1e6, doc="Stiffness of the joint position control, N m/rad."
    )
    joint_damping_ratio: float = setting(
        1.0, low=0.05, high=5.0, doc="Damping ratio of the joint position control."
    )
    joint_friction: float = setting(
        0.0, low=0.0, high=1.0, doc="Share of the published joint friction that acts."
    )
    joint_yield_rad_Nm: float = setting(
        0.0,
        low=0.0,
        high=1e-3,
        doc="Compliance behind each encoder, position control, rad/(N m).",
    )
    feed_forward: bool = setting(
        True, doc="Whether the position control adds the wrench of the controller's model."
    )
    controller_model: str = setting(
        "", doc="Model file of the controller (`ecm fit`); empty: energy4 fitted to the plan's FEM."
    )
    elbow_rad: float = setting(
        0.0, low=-1.5, high=1.5, doc="Swivel angle of the elbow at home, 0 is up, rad."
    )
    settle_limit_s: float = setting(
        3.0, low=0.05, high=60.0, doc="Longest wait for the arm to come to rest, s."
    )
    reach_tolerance_m: float = setting(
        2e-4,
        low=1e-7,
        high=0.1,
        doc="Accepted distance from the goal, by the encoders, m.",
    )
    reach_tolerance_rad: float = setting(
        1e-3, low=1e-7, high=0.5, doc="Accepted angle from the goal, by the encoders, rad."
    )
    force_limit_N: float = setting(
        300.0, low=1.0, high=1e4, doc="Largest norm of the force at the top frame, N."
    )
    torque_limit_Nm: float = setting(
        20.0, low=0.1, high=1e3, doc="Largest norm of the torque at the top frame, N m."
    )
    contact_limit_N: float = setting(
        15.0, low=0.1, high=1e4, doc="Largest force that the model does not explain, N."
    )
    speed_limit_m_s: float = setting(
        0.25, low=1e-3, high=2.0, doc="Largest speed of the top frame, m/s."
    )
    singularity_limit: float = setting(
        0.05,
        low=0.0,
        high=1.0,
        doc="Smallest singular value of the Jacobian with lengths divided by 0.4 m.",
    )
    joint_margin_rad: float = setting(
        0.035, low=0.0, high=1.0, doc="Distance kept from the end of each joint's range, rad."
    )
    stop_m: float = setting(
        0.0,
        low=0.0,
        high=1.0,
        doc="Gap between target plate and a wall at positive y, m; 0: no wall.",
    )
    fault: str = setting(
        "", doc="Rehearsed faults, e.g. `sensor_nan@5, led_loss@9+`: at a visit, or from it on."
    )
    processes: int = setting(
        0, low=0, high=1024, doc="Processes that simulate; 0: one per core, at most 8."
    )
