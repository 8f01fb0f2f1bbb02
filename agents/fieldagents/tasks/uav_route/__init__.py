"""UAV route: the mixed-integer programs of the source as printed and as they work, and other planners.

Source: chapter 4 of the dissertation named in docs/uav_route.md ("the source" in this package). Each
planner takes a layout and a world and returns a ``Plan`` with the verification of the continuous model.
The programs need the ``planning`` extra; lattice and straight line do not.
"""
