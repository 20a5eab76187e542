"""The names that users rely on exist, are documented, and are the ones listed."""

import inspect

import pytest

import wbc


def test_public_names_are_documented() -> None:
    assert not [name for name in wbc.__all__ if not inspect.getdoc(getattr(wbc, name))]


def test_public_names_are_those_of_the_rooms() -> None:
    wanted = {"ComTask", "Contact", "KinematicController", "Robot", "Obstacle", "Bounds"}
    assert wanted <= set(wbc.__all__) == set(dir(wbc))
    assert not [name for name in dir(wbc) if name.startswith("_") and name != "__version__"]


def test_unknown_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Robto'; did you mean 'Robot'"):
        _ = wbc.Robto


@pytest.mark.parametrize(
    ("there", "here"), [("FrameTask", "PoseTask"), ("solve_ik", "KinematicController")]
)
def test_names_of_other_packages_lead_to_ours(there: str, here: str) -> None:
    with pytest.raises(AttributeError, match=f"no attribute '{there}'; did you mean '{here}'"):
        getattr(wbc, there)


SNAPSHOT = (
    "com com_jacobian com_drift inertia inertia_jacobian inertia_drift momentum centroidal_map "
    "mechanical_connection mass_matrix bias"
)


def test_snapshot_names() -> None:
    robot = wbc.Robot.load("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    shapes = {name: getattr(here, name).shape for name in SNAPSHOT.split()}
    assert shapes["inertia"] == (3, 3)
    assert shapes["inertia_jacobian"] == (6, robot.nv)
    assert shapes["inertia_drift"] == (6,)
    assert shapes["com_jacobian"] == (3, robot.nv)
