"""A recorded motion as a pendulum: CoP, leg and ellipsoid from a file of joint angles.

The recording is made here by running a problem; a CSV from a motion capture or from encoders, with
one column per joint, is read in the same way.
"""

import tempfile
from pathlib import Path

import numpy as np

import wbc
from wbc.run import Result

PROBLEMS = Path(__file__).parents[1] / "problems"

with tempfile.TemporaryDirectory() as folder:
    result = wbc.load_problem(PROBLEMS / "fig7_downward_hoap2.yaml").run()
    assert isinstance(result, Result)  # a robot's, not a pendulum's
    recording = Path(folder) / "squat.npz"
    result.save(recording)
    motion = wbc.read_motion(recording, result.robot)
    series = wbc.analyze(motion, cutoff=5.0)
    series.save(Path(folder) / "pendulum.csv")  # one line per frame, units in the first line

assert series.cop_margin is not None  # this robot has feet
lengths, axes = series.leg_length, series.semi_axes
print(f"{len(series)} frames in {series.time[-1]:.2f} s, feet {', '.join(series.feet)}")
print(f"leg from {lengths[0]:.3f} to {lengths[-1]:.3f} m")
print(f"CoP at least {1e3 * series.cop_margin.min():.1f} mm inside the support")
print(f"semi-axes from {axes[0].round(3)} to {axes[-1].round(3)} m")
spin, turn = series.average_angular_velocity, series.axes_angular_velocity
print(
    f"angular momentum / inertia up to {np.abs(spin).max():.2f} rad/s, "
    f"axes turn at up to {np.nanmax(np.abs(turn)):.2f} rad/s"
)
