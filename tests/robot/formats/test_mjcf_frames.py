"""Frames of an MJCF. Oracle: where MuJoCo's own compiler puts bodies and shapes."""

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import assert_agree, load

TURNED = {
    "quat": 'quat="0.6 0.8 0 0"',
    "unnormalised quat": 'quat="1 2 -1 0.5"',
    "axisangle": 'axisangle="1 -2 0.5 {40}"',
    "euler": 'euler="{30} {-50} {70}"',
    "xyaxes": 'xyaxes="1 1 0 -1 2 0.5"',
    "zaxis": 'zaxis="1 -0.3 -0.2"',
    "none": "",
}
SEQUENCES = ("xyz", "zyx", "XYZ", "zXy")


def content(turned: str, compiler: str, scale: float, root: str) -> str:
    for number in ("30", "-50", "70", "40"):
        turned = turned.replace("{" + number + "}", repr(float(number) * scale))
    geom = f'<geom name="{{0}}" type="box" size=".1 .2 .3" mass="1" pos="0.1 0 0.2" {turned}/>'
    return f"""<mujoco model="m"><compiler {compiler}/>
      <default><default class="thin"><geom type="capsule" size="0.03"/></default></default>
      <worldbody><frame pos="0 0 1"><body name="trunk" pos=".2 .1 .3" {turned}>{root}
        {geom.format("trunk")}
        <frame pos="0.1 -0.2 0.3" {turned} childclass="thin">
          <geom name="rod" fromto="0 0 0 0.1 0.2 0.3" mass="0.5"/>
          <frame pos="-0.3 0 0.1" {turned}>
            <body name="arm" pos="0 0 0.4" {turned}><joint name="arm" axis="1 0 0" range="-1 1"/>
              {geom.format("arm")}
              <frame {turned}><body name="hand" pos="0 .1 0"><joint name="hand" range="-1 1"/>
                {geom.format("hand")}</body></frame>
            </body>
            <camera name="eye"/>
          </frame>
        </frame>
      </body></frame></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("turned", "sequence"),
    [(name, "xyz") for name in TURNED] + [("euler", one) for one in SEQUENCES],
)
@pytest.mark.parametrize("degrees", [True, False])
@pytest.mark.parametrize("root", ["<freejoint/>", ""], ids=["floating", "bolted"])
def test_frames_are_where_mujoco_puts_them(
    turned: str, sequence: str, degrees: bool, root: str
) -> None:
    """In MuJoCo's own zero posture, the root where the file puts it, but for the joints."""
    compiler = f'angle="{"degree" if degrees else "radian"}" eulerseq="{sequence}"'
    scale = 1.0 if degrees else np.pi / 180.0
    robot, model = load(content(TURNED[turned], compiler, scale, root))
    assert_agree(robot, model)
    np.testing.assert_allclose(robot.limits.upper, np.pi / 180.0 if degrees else 1.0)
    assert robot.mass == pytest.approx(3.5)
    assert len(robot.collision_model.geometryObjects) == 4
