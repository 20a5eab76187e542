"""Whole-body control of humanoid robots, with the robot's inertia as a task like any other."""
