"""Damaged recordings: typed errors, or a recording, and nothing else.

``WBC_FUZZ=N`` tries N damaged files of each kind instead of a few hundred.
"""

import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.damage import damaged
from tests.human.test_files import write_bodies, write_bvh, write_c3d
from tests.human.walker import recorded, write_trc
from wbc.errors import WbcError
from wbc.human import human_motion, read_markers
from wbc.human.body import HumanBody

COUNT = int(os.environ.get("WBC_FUZZ", "300"))
BODY = HumanBody.of(1.76, 72.0, "male")
MOT = """grf
nRows=3
nColumns=10
endheader
time\tground_force_vx\tground_force_vy\tground_force_vz\tground_force_px\tground_force_py\tground_force_pz\tground_torque_x\tground_torque_y\tground_torque_z
0\t10\t700\t-5\t0.1\t0\t0.2\t0\t3\t0
0.1\t10\t700\t-5\t0.1\t0\t0.2\t0\t3\t0
0.2\t10\t700\t-5\t0.1\t0\t0.2\t0\t3\t0
"""


def write_smpl(path: Path) -> None:
    poses = np.random.default_rng(0).standard_normal((9, 72))
    np.savez(path, poses=poses, trans=np.zeros((9, 3)), mocap_framerate=60.0)


def write_mot(path: Path) -> None:
    path.write_text(MOT)


WRITERS: dict[str, Callable[[Path], object]] = {
    "c3d": lambda path: write_c3d(path, 0.1),
    "trc": lambda path: write_trc(path, recorded(BODY, seconds=0.1)[0]),
    "bvh": write_bvh,
    "csv": write_bodies,
    "npz": write_smpl,
    "mot": write_mot,
}


def tried(folder: Path, ending: str, count: int, seed: int) -> dict[str, int]:
    """Read mutations of a file; return how many were refused, and how many read."""
    whole = folder / f"whole.{ending}"
    WRITERS[ending](whole)
    WRITERS["trc"](folder / "beside.trc")
    data, rng = whole.read_bytes(), random.Random(seed)
    found = {"refused": 0, "read": 0, "fitted": 0}
    path = folder / f"damaged.{ending}"
    for number in range(count):
        path.write_bytes(damaged(data, rng))
        try:
            if ending == "mot":
                recording = read_markers(folder / "beside.trc", forces=path)
            else:
                recording = read_markers(path)
            found["read"] += 1
            assert np.isfinite(recording.time).all() and not np.isinf(recording.positions).any()
            if number % 50 == 0 and len(recording.time) < 30:
                human = human_motion(recording, mass=70.0)
                assert np.isfinite(human.motion.joints).all()
                found["fitted"] += 1
        except WbcError as error:
            found["refused"] += 1
            assert len(str(error)) < 3000
    return found


@pytest.mark.parametrize("count", [49, pytest.param(COUNT, marks=pytest.mark.slow)])
@pytest.mark.parametrize("ending", WRITERS)
def test_damaged_files_raise_typed_errors(tmp_path: Path, ending: str, count: int) -> None:
    found = tried(tmp_path, ending, count, 2)
    assert found["refused"] > count / 25 and found["read"] >= count // 150
