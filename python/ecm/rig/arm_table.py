"""Keys of [rig] that only the robot has, beside those of every rig."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.io.settings import setting


@dataclass(frozen=True)
class ArmTable:
    """[rig], mode = "robot": controllers, limits, scene."""

    step_s: float = setting(1e-3, low=1e-5, high=2e-3)
    """Of the simulation and of the controllers."""
    impedance_N_m: float = setting(5000.0, low=10.0, high=5000.0)
    impedance_Nm_rad: float = setting(300.0, low=1.0, high=300.0)
    """Cartesian stiffness of the first phase, all axes; the maker's largest."""
    damping_ratio: float = setting(0.7, low=0.05, high=2.0)
    """Of arm, controller and mechanism together, mode by mode."""
    nullspace_Nm_rad: float = setting(50.0, low=0.0, high=500.0)
    """Holds the elbow where it was at home."""
    joint_stiffness_Nm_rad: float = setting(30000.0, low=100.0, high=1e6)
    joint_damping_ratio: float = setting(1.0, low=0.05, high=5.0)
    """Of the joint position controller."""
    joint_friction: float = setting(0.0, low=0.0, high=1.0)
    """Share of the joints' identified friction that their own torque control leaves."""
    joint_yield_rad_Nm: float = setting(0.0, low=0.0, high=1e-3)
    """In position control a joint gives way so far behind its encoder, per N m that it holds."""
    feed_forward: bool = setting(True)
    """The joint position controller adds the wrench of the controller's model."""
    controller_model: str = setting("")
    """Model file (`ecm fit`) of the feed-forward; empty: energy4 fitted to the plan's FEM."""
    elbow_rad: float = setting(0.0, low=-1.5, high=1.5)
    """Swivel angle of the elbow at home, 0 is up."""
    settle_limit_s: float = setting(3.0, low=0.05, high=60.0)
    """Longest wait for the arm to come to rest."""
    reach_tolerance_m: float = setting(2e-4, low=1e-7, high=0.1)
    reach_tolerance_rad: float = setting(1e-3, low=1e-7, high=0.5)
    """A pose counts as reached within these, by the arm's own encoders."""
    force_limit_N: float = setting(300.0, low=1.0, high=1e4)
    torque_limit_Nm: float = setting(20.0, low=0.1, high=1e3)
    """Of the wrench at the top frame, norms."""
    contact_limit_N: float = setting(15.0, low=0.1, high=1e4)
    """Force that neither the model of the mechanism nor the arm's motion explains."""
    speed_limit_m_s: float = setting(0.25, low=1e-3, high=2.0)
    """Of the top frame."""
    singularity_limit: float = setting(0.05, low=0.0, high=1.0)
    """Smallest singular value of the Jacobian, lengths over 0.4 m."""
    joint_margin_rad: float = setting(0.035, low=0.0, high=1.0)
    """Kept free before the end of each joint's range."""
    stop_m: float = setting(0.0, low=0.0, high=1.0)
    """A wall at this y beside the target plate's rim at rest; 0: none."""
    fault: str = setting("")
    """Rehearsed faults, `sensor_nan@5, led_loss@9+`: at a visit, or from it on (see docs)."""
    processes: int = setting(0, low=0, high=1024)
    """Simulated side by side; 0: as many as cores, at most 8."""
