"""Collision shapes of a robot: simple, conservative, and fast to ask for distances."""

from wbc.robot.collision.bodies import robot_bodies
from wbc.robot.collision.cache import cache_folder
from wbc.robot.collision.model import CollisionModel, Proximity
from wbc.robot.collision.obstacles import Obstacle
from wbc.robot.collision.pairs import Selection, select_pairs
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Shape

__all__ = [
    "Body",
    "Capsule",
    "CollisionModel",
    "HalfSpace",
    "Hull",
    "Obstacle",
    "Proximity",
    "Selection",
    "Shape",
    "cache_folder",
    "robot_bodies",
    "select_pairs",
]
