"""Human motion on humanoids: feet that do not slide, the human's CoM, momentum and ellipsoid."""

from wbc.retargeting.body_map import BodyMap, body_map
from wbc.retargeting.pipeline import retarget
from wbc.retargeting.result import Reached, Retargeted
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.tasks import RetargetWeights
from wbc.tracking.deviation import Unbalanced

__all__ = [
    "BodyMap",
    "MotionScale",
    "Reached",
    "RetargetWeights",
    "Retargeted",
    "Unbalanced",
    "body_map",
    "retarget",
]
