"""Broken robot files end in typed errors: seeded mutations of whole documents.

``WBC_FUZZ=N`` tries N mutations of each document instead of a few seconds' worth.
"""

import copy
import os
import random
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from tests import urdf as toy
from wbc.errors import ModelError, WbcError
from wbc.robot import Robot

COUNT = int(os.environ.get("WBC_FUZZ", "150"))

BOX, BALL = 'box size="0.2 0.1 0.02"', 'sphere radius="0.04"'
TUBE = 'cylinder radius="0.03" length="0.2"'
LIMIT = '<limit lower="-1" upper="1.5" effort="20" velocity="5"/>'


def link(name: str, inside: str = "") -> str:
    return toy.link(name, inside, 1.5, (0.02, 0.02, 0.01), "0 0 -0.05")


def joint(name: str, kind: str, parent: str, child: str, inside: str = "", y: float = 0.0) -> str:
    inside += '<dynamics damping="0.1"/>'
    at = {"at": f"0 {y} -0.2", "limit": LIMIT, "kind": kind}
    return toy.joint(name, parent, child, inside, **at)


def shapes(collides: str, drawn: str) -> str:
    return toy.collision(collides, "0.02 0 -0.15") + (
        f'<visual><geometry><{drawn}/></geometry><material name="m"><color rgba="1 0 0 1"/>'
        "</material></visual>"
    )


def urdf() -> str:
    parts = [link("torso", shapes(BOX, BOX))]
    for side, y in (("left", 0.1), ("right", -0.1)):
        knee, foot, toe = f"{side}_shank", f"{side}_foot", f"{side}_toe"
        parts += [link(knee, shapes(TUBE, TUBE)), link(foot, shapes(BOX, BALL))]
        tie = '<mimic joint="left_j0" multiplier="-1" offset="0.01"/>' if side == "right" else ""
        parts += [
            f'<link name="{toe}"/>',
            joint(f"{side}_j0", "revolute", "torso", knee, tie, y),
            joint(f"{side}_j1", "continuous", knee, foot),
            joint(f"{side}_j2", "fixed", foot, toe),
        ]
    return toy.robot("toy", *parts)


def mjcf() -> str:
    leg = (
        '<body name="{s}_thigh" pos="0 {y} -.1" euler="0 5 0"><joint name="{s}_yaw" axis="0 0 1"/>'
        '<joint name="{s}_hip" class="leg" range="-60 60"/>'
        '<inertial pos="0 0 -.1" mass="2" diaginertia=".02 .02 .01"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03"/>'
        '<body name="{s}_foot" pos="0 0 -.3"><joint name="{s}_ankle" class="leg"'
        ' actuatorfrcrange="-9 9"/><geom type="box" pos=".03 0 -.03" size=".1 .04 .01" mass=".5"/>'
        '<site name="{s}_site" pos="0 0 -.04"/></body></body>'
    )
    legs = "".join(leg.format(s=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))
    return (
        '<mujoco model="toy"><compiler angle="degree" autolimits="true"/><option timestep="0.002"/>'
        '<default><geom rgba="1 0 0 1"/><default class="leg"><joint axis="0 1 0" armature=".01"/>'
        '</default></default><worldbody><geom type="plane" size="1 1 1"/>'
        '<body name="pelvis" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/>'
        f'{legs}</body></worldbody><actuator><motor joint="left_hip"/></actuator>'
        '<equality><joint joint1="left_ankle" joint2="right_ankle" polycoef="0 -1"/></equality>'
        '<keyframe><key name="home" qpos="0 0 1 1 0 0 0 0 0 0 0 0 0"/></keyframe></mujoco>'
    )


SRDF = (
    '<robot name="toy"><group_state name="half_sitting" group="all">'
    '<joint name="left_j0" value="0.3"/><joint name="right_j1" value="0.2 0.5"/>'
    '<joint name="root_joint" value="0 0 1 0 0 0 1"/></group_state>'
    '<disable_collisions link1="torso" link2="left_shank" reason="Adjacent"/></robot>'
)

WORDS = (
    *("", " ", "0", "-0", "-1", "1", "1e-320", "1e308", "-1e308", "1e309", "nan", "inf", "-inf"),
    *("0 0", "0 0 0", "0 0 0 0", "1 2 3", "1e200 1e200 1e200", "nan nan nan", "1,5", "0x10", "1_0"),
    *("١٢", "a", "\u00e9", "torso", "left_foot", "left_j0", "pelvis", "leg", "../x.stl"),
    *("package://a/b.stl", "x" * 5000, "mesh", "box", "plane", "hfield", "ball", "free", "slide"),
    *("fixed", "floating", "planar", "revolute", "true", "false", "radian", "1 " * 300, "\t\n"),
)


def mutated(text: str, rng: random.Random) -> str:
    """Return a document with one to four changes to its tree, or to its bytes."""
    if rng.random() < 0.1:
        data = bytearray(text.encode())
        for _ in range(rng.randint(1, 5)):
            data[rng.randrange(len(data))] = rng.randrange(1, 256)
        return data.decode("latin-1")
    root = ET.fromstring(text)
    for _ in range(rng.randint(1, 4)):
        elements = list(root.iter())
        element, other = rng.choice(elements), rng.choice(elements)
        keys = list(element.attrib)
        match rng.randrange(9):
            case 0 if len(element):
                element.remove(rng.choice(list(element)))
            case 1 if len(element):
                element.append(copy.deepcopy(rng.choice(list(element))))
            case 2 if element not in set(other.iter()):
                element.append(copy.deepcopy(other))
            case 3 if keys:
                del element.attrib[rng.choice(keys)]
            case 4 if keys and other.attrib:
                element.set(rng.choice(keys), rng.choice(list(other.attrib.values())))
            case 5 if other.attrib:
                element.set(*rng.choice(list(other.attrib.items())))
            case 6:
                element.tag = other.tag
            case _ if keys:
                element.set(rng.choice(keys), rng.choice(WORDS))
            case _:
                element.text = rng.choice(WORDS)
    return ET.tostring(root, encoding="unicode")


def check(path: Path, srdf: Path | None = None) -> None:
    """Load a file; what loads must be finite, and weigh what its links weigh."""
    try:
        robot = Robot.load(path, srdf=srdf)
    except WbcError as error:
        assert str(path) in str(error) or (srdf and str(srdf) in str(error)) or "foot" in str(error)
        return
    assert np.isfinite(robot.mass) and robot.mass > 0.0
    for q in robot.postures.values():
        assert np.isfinite(q).all()
        assert np.linalg.norm(q[3:7]) == pytest.approx(1.0)
    s = robot.snapshot(robot.posture("standing"))
    assert np.isfinite(s.inertia).all() and np.isfinite(s.com).all()
    if path.suffix == ".urdf":
        masses = ET.parse(path).findall("link/inertial/mass")
        assert robot.mass == pytest.approx(sum(float(m.get("value", "0")) for m in masses))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["urdf", "mjcf", "srdf"])
@pytest.mark.filterwarnings("ignore")
def test_mutated_files_end_in_typed_errors(tmp_path: Path, kind: str) -> None:
    whole = {"urdf": urdf(), "mjcf": mjcf(), "srdf": SRDF}
    robot = tmp_path / ("toy.xml" if kind == "mjcf" else "toy.urdf")
    robot.write_text(whole["mjcf" if kind == "mjcf" else "urdf"])
    srdf = tmp_path / "toy.srdf"
    srdf.write_text(SRDF)
    target = srdf if kind == "srdf" else robot
    check(robot, None if kind == "mjcf" else srdf)
    for seed in range(COUNT):
        text = mutated(whole[kind], random.Random(seed))
        target.write_text(text, encoding="utf-8", errors="surrogateescape")
        try:
            check(robot, None if kind == "mjcf" else srdf)
        except Exception as error:
            raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}\n{text}") from error


def chain(count: int, kind: str, branched: bool = False) -> str:
    parts = [link("l0")]
    for k in range(count):
        parts.append(link(f"l{k + 1}"))
        parts.append(joint(f"j{k}", kind, f"l{0 if branched else k}", f"l{k + 1}"))
    return toy.robot("x", *parts)


def scaled(scale: str) -> str:
    mesh = toy.collision(f'mesh filename="m.stl" scale="{scale}"')
    return toy.robot("x", link("a", mesh))


ATTACKS = {
    "a chain of 500 joints": (lambda: chain(500, "revolute"), "500 moving joints"),
    "a tree of 500 joints": (lambda: chain(500, "revolute", branched=True), "500 moving joints"),
    "20000 fixed joints": (lambda: chain(20_000, "fixed"), "more than 100000 elements"),
    "8000 fixed joints": (lambda: chain(8_000, "fixed"), "chain of more than 1000 links"),
    "nesting": (lambda: "<mujoco>" + "<body>" * 1500 + "</body>" * 1500 + "</mujoco>", "nested"),
    "attributes": (
        lambda: "<robot " + " ".join(f'a{k}="1"' for k in range(10**5)) + "/>",
        "more than 200 attributes",
    ),
    "encoding": (lambda: '<?xml version="1.0" encoding="foo-8"?><robot/>', "unknown encoding"),
    "zero bytes": (lambda: "<robot>\0</robot>", "not a text file"),
    "mesh scale": (lambda: scaled("1e308 1e308 1e308"), "larger than 1e+09"),
    "not a scale": (lambda: scaled("1 1"), "expected 3 finite numbers"),
    "two masses": (
        lambda: chain(1, "revolute").replace("</inertial>", '<mass value="9"/></inertial>'),
        "<mass> is given twice",
    ),
}


@pytest.mark.parametrize("case", ATTACKS)
def test_attacks_are_refused(tmp_path: Path, case: str) -> None:
    make, words = ATTACKS[case]
    path = tmp_path / "attack.xml"
    path.write_text(make())
    with pytest.raises(ModelError, match=re.escape(words)):
        Robot.load(path)


@pytest.mark.parametrize("name", ["x" * 5000 + ".urdf", "a\0b.urdf"])
def test_impossible_file_names_are_refused(name: str) -> None:
    with pytest.raises(ModelError):
        Robot.load(name)


@pytest.mark.parametrize("value", ["", "1e300 1e300 1e300 0 0 0 1", "0 0 0", "0 0 0 0 0 0 1e-9"])
def test_srdf_values_that_are_no_configuration_are_refused(tmp_path: Path, value: str) -> None:
    path = tmp_path / "states.srdf"
    path.write_text(SRDF.replace("0 0 1 0 0 0 1", value))
    with pytest.raises(ModelError, match=r"'root_joint': .* nor a base's configuration"):
        Robot.load("hoap2_like", srdf=path)


def test_too_few_numbers_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "toy.xml"
    for text in ('pos="0 0"', 'quat="1 0 0"', 'quat="0 0 0 0"'):
        path.write_text(mjcf().replace('pos="0 0 -.3"', text, 1))
        with pytest.raises(ModelError, match=r"toy\.xml: .*('body'|'left_foot')"):
            Robot.load(path)
    path.write_text(mjcf().replace('size=".1 .04 .01"', 'size=".1"', 1))
    with pytest.raises(ModelError, match=r"size 1 must be positive in geom"):
        Robot.load(path)
