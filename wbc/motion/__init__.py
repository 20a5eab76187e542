"""Recorded motion: read, made even in time, filtered, and reduced to its pendulum."""
