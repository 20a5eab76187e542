"""Problems of the pendulum itself: ``model: rmp_planar`` or ``rmp_solid``."""
