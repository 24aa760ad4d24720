"""The manipulator of the rig: a 7-axis arm in MuJoCo that carries out the paper's procedure.

`[rig] mode = "robot"`. The world frame of the simulation is the base frame of the mechanism, so
poses and wrenches need no transformation; the arm stands beside it with its first axis along x.
"""
