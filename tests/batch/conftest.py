"""A problem that runs in milliseconds, and campaigns of it."""

from pathlib import Path

import pytest

from tests.texts import CHEAP

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
    (tmp_path / "stand.yaml").write_text(CHEAP)
    path = tmp_path / "campaign.yaml"
    path.write_text(CAMPAIGN)
    return path
