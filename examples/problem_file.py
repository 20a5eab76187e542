"""A problem file from Python: load it, change values, run it, save the result.

The same as `wbc run` in four calls; mistakes in the file are errors with line and key.
"""

import tempfile
from pathlib import Path

import wbc
from wbc.run import Result

PROBLEMS = Path(__file__).parents[1] / "problems"
FILE = PROBLEMS / "fig7_forward_hoap2.yaml"

for gain in (0.05, 0.2):
    result = wbc.load_problem(FILE, {"tasks.com.gain": gain, "stop.duration": 8.0}).run()
    assert isinstance(result, Result)  # a robot's, not a pendulum's
    com, slip = result.tasks["com"], result.slip
    assert slip is not None  # it stands
    print(
        f"gain {gain:g}: {result.status.value} after {len(result.history)} ticks, "
        f"CoM off by {1e3 * com.norm:.1e} mm, feet moved {1e3 * slip.value:.1e} mm"
    )

with tempfile.TemporaryDirectory() as folder:
    result.save(Path(folder) / "result.json")  # the summary
    result.save(Path(folder) / "result.npz")  # every tick: q, v, CoM, inertia, errors, margins
    sizes = {path.name: path.stat().st_size for path in sorted(Path(folder).iterdir())}
print(", ".join(f"{name}: {size / 1e3:.0f} kB" for name, size in sizes.items()))

try:
    wbc.load_problem(FILE, {"tasks.com.gian": 0.1})
except wbc.WbcError as error:
    print(f"a mistake: {error}")
