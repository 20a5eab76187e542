"""Time of `wbc view` from Enter until a page has the robot: the first time, and again.

Its caches are in an empty folder at first. The client reads what a browser reads and draws nothing:
the browser's part depends on its graphics. It reports the seconds until the address is printed, and
until the last mesh has arrived.

    python benchmarks/viewer_start.py [problems/push_g1.yaml ...] [--output benchmarks/RESULTS.md]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import viser
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table
from viewer import CAMERA
from websockets.sync.client import connect

PROBLEMS = Path(__file__).parents[1] / "problems"
SHIPPED = PROBLEMS / "push_g1.yaml", PROBLEMS / "astronaut_expand.yaml"
MESH = 20_000  # bytes of a message that is no frame
LISTENS = 5.0  # s after the address
TIMES = 3


def start_times(problem: Path, cache: str) -> tuple[float, float]:
    """Return the seconds until the address is printed, and until all meshes have arrived."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "wbc", "view", str(problem)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_CACHE_HOME": cache}
    )
    try:
        assert process.stdout is not None
        line = next(line for line in process.stdout if "http://" in line)
        address = time.perf_counter() - begun
        url = line.split("http://")[1].strip().replace("localhost", "127.0.0.1")
        protocol = f"viser-v{viser.__version__}"
        with connect(f"ws://{url}", subprotocols=[protocol], max_size=None) as client:
            client.send(msgspec.msgpack.encode({**CAMERA, "type": "ViewerCameraMessage"}))
            last = address
            while (left := begun + address + LISTENS - time.perf_counter()) > 0.0:
                try:
                    message = client.recv(timeout=left)
                except TimeoutError:
                    break
                if len(message) > MESH:
                    last = time.perf_counter() - begun
        return address, last
    finally:
        process.terminate()
        process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problems", nargs="*", type=Path, default=SHIPPED)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    rows = []
    for problem in options.problems:
        with tempfile.TemporaryDirectory() as cache:
            found = [start_times(problem, cache) for _ in range(TIMES)]
        for when, (address, meshes) in zip(("first", "again", "again"), found, strict=True):
            rows.append((problem.stem, when, f"{address:.1f}", f"{meshes:.1f}"))
    columns = "problem", "time", "address", "all meshes"
    table = Table("From Enter to the robot on the page [s]", columns, rows)
    print(table.markdown())
    if options.output is not None:
        text = f"{table.markdown()}\n\n{machine()}. Command: python {' '.join(sys.argv)}"
        put_section(options.output, "viewer-start", text)


if __name__ == "__main__":
    main()
