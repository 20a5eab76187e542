"""A pendulum's plan on a robot: made from it, checked against it, followed, and judged."""
