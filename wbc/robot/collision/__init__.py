"""Collision shapes of a robot: simple and conservative, with fast distances."""

from wbc.robot.collision.bodies import robot_bodies
from wbc.robot.collision.cached_pairs import chosen_pairs, fitted_bodies
from wbc.robot.collision.model import CollisionModel, PairDistances
from wbc.robot.collision.pairs import Selection, select_pairs
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Obstacle, Shape

__all__ = [
    "Body",
    "Capsule",
    "CollisionModel",
    "HalfSpace",
    "Hull",
    "Obstacle",
    "PairDistances",
    "Selection",
    "Shape",
    "chosen_pairs",
    "fitted_bodies",
    "robot_bodies",
    "select_pairs",
]
