"""A pendulum's plan on a robot: its pendulum, the check of the plan, targets, tracking errors."""
