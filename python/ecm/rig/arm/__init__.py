"""The arm of the rig, `[rig] mode = "robot"`: a 7-axis KUKA LWR 4+ in MuJoCo, Fig. 7 of the paper.

The world frame of the simulation is the base frame of the mechanism, so poses and wrenches need no
transformation; the arm stands beside it with its first axis along x.
"""
