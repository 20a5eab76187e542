"""Problem files for the pendulum alone: ``model: rmp_planar`` or ``rmp_solid``."""
