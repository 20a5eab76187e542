"""A second reading of the file confirms what each joint carries, not only what all of it weighs."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from wbc.errors import ModelError
from wbc.robot.formats import read_description
from wbc.robot.formats.description import confirm

HERE = Path("somewhere.urdf")
LINKS = {"base": 4, "flange": 0.5, "upper": 2, "lower": 1, "tip": 0.25}
URDF = urdf.robot(
    "arm",
    *(urdf.link(name, mass=mass, moment=1) for name, mass in LINKS.items()),
    urdf.joint("bolted", "base", "flange", kind="fixed", limit=""),
    urdf.joint("shoulder", "flange", "upper", kind="continuous", limit=""),
    urdf.joint("elbow", "upper", "lower", kind="continuous", limit=""),
    urdf.joint("glued", "lower", "tip", kind="fixed", limit=""),
)
MASSES = {"": 4.5, "shoulder": 2.0, "elbow": 1.25}


@pytest.fixture
def model(tmp_path: Path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    return read_description(path, ()).model


@pytest.mark.parametrize(
    ("masses", "told"),
    [
        ({"": 4.5, "shoulder": 2.0, "elbow": 1.0}, "sum to 7.5 kg, but 7.75 kg"),
        ({"": 4.5, "shoulder": 1.25, "elbow": 2.0}, "joint 'shoulder' carries 1.25 kg, but 2 kg"),
        ({"": 5.5, "shoulder": 1.0, "elbow": 1.25}, "the root weighs 5.5 kg, but 4.5 kg"),
        ({"": np.nan, "shoulder": 2.0, "elbow": 1.25}, "sum to nan kg, but 7.75 kg"),
    ],
)
def test_masses_in_other_places_are_found(model, masses: dict[str, float], told: str) -> None:
    confirm(model, MASSES, ["shoulder", "elbow"], HERE)
    with pytest.raises(ModelError, match=told):
        confirm(model, masses, ["shoulder", "elbow"], HERE)


def test_joints_that_are_not_there_are_found(model) -> None:
    with pytest.raises(ModelError, match="joints 'wrist' were not read"):
        confirm(model, MASSES, ["shoulder", "elbow", "wrist"], HERE)


def test_a_reader_that_swaps_two_bodies_is_caught(tmp_path: Path, monkeypatch) -> None:
    """The parser is made to give the links' masses to each other."""
    build = pin.buildModelFromXML

    def swapped(text: str, *joint):
        text = text.replace('value="2"', 'value="x"').replace('value="0.5"', 'value="2"')
        return build(text.replace('value="x"', 'value="0.5"'), *joint)

    monkeypatch.setattr(pin, "buildModelFromXML", swapped)
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    with pytest.raises(ModelError, match=r"the root weighs 4\.5 kg, but 6 kg were read"):
        read_description(path, ())
