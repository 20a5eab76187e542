"""A problem that runs in milliseconds, and campaigns of it."""

from pathlib import Path

import pytest

STAND = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0, 0, -0.01]}, weight: 10.0}
  posture: {type: posture, weight: 0.01}
controller: {solver: daqp}
stop: {duration: 0.02, speed: null}
"""
CAMPAIGN = """\
problems: [stand.yaml]
grid:
  tasks.com.gain: [0.1, 0.2, 0.5]
  controller.solver: [daqp, proxqp]
seeds: 2
draw:
  tasks.com.target.offset: [[-0.01, -0.01, -0.02], [0.01, 0.01, 0.0]]
"""


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Return the file of a campaign of 12 runs."""
    (tmp_path / "stand.yaml").write_text(STAND)
    path = tmp_path / "campaign.yaml"
    path.write_text(CAMPAIGN)
    return path
