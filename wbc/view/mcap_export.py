"""A run as an MCAP file, which Foxglove, Rerun and PlotJuggler open.

Messages are JSON, each with a schema. ``/tf`` holds the robot's frames as
``foxglove.FrameTransforms`` under the names of its URDF, so that a viewer that has the URDF shows
the robot; all other topics are numbers by name.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wbc import __version__
from wbc.extras import require
from wbc.files import ending_of, write_whole
from wbc.retargeting import Retargeted
from wbc.robot import Robot, Snapshot
from wbc.run.history import History
from wbc.tasks.force_task import WRENCH
from wbc.validate import Array

WORLD, NANO = "world", 1_000_000_000
XYZ, XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
TRANSFORMS = "foxglove.FrameTransforms"


class Topic(NamedTuple):
    """A stream of numbers: its name, and the names and values (n, k) of its entries."""

    name: str
    entries: tuple[str, ...]
    values: Array


def mcap_format(path: str | Path) -> None:
    """Raise InvalidInputError for another ending, MissingPackageError if mcap is not installed."""
    ending_of(path, (".mcap",), "a run is exported as .mcap")
    require("mcap", "a recording")


def write_mcap(
    robot: Robot,
    history: History,
    summary: Mapping[str, Any],
    path: str | Path,
    *,
    simulation: Mapping[str, NDArray[Any]] | None = None,
) -> Path:
    """Write a run, one message per topic and tick, and return its path; whole or not at all.

    Topics: ``/tf``; ``/joints/position`` and ``/joints/velocity`` [rad, m; per s]; ``/com`` [m];
    ``/errors/TASK``, in the task's own unit; ``/clearance``, what is left of each margin. Of a
    simulation also ``/joints/torque`` [N m, N], ``/forces/FRAME`` at the frame's origin in world
    axes [N, N m], and ``/cop`` [m]. What is not finite is null. The problem's text is attached, the
    summary is metadata.

    ``simulation``: arrays of a simulation, as :meth:`wbc.simulation.SimulationResult.save` writes
    them.

    Raises InvalidInputError: another ending; MissingPackageError: the package mcap is not
    installed; OSError: the file cannot be written.
    """
    mcap_format(path)
    snapshots = [robot.snapshot(q) for q in history.q]
    topics = [*_of_run(snapshots, history, summary), *_of_simulation(robot, simulation or {})]
    return _write(path, snapshots, history.time, topics, summary)


def write_retargeted(motion: Retargeted, path: str | Path) -> Path:
    """Write a retargeted motion, one message per topic and frame, and return its path.

    Topics as of :func:`write_mcap` where it has them, forces at the feet by name; besides
    ``/human/com`` [m] and ``/human/angular_momentum`` [kg m^2/s], scaled to the robot.

    Raises InvalidInputError, MissingPackageError, OSError: see :func:`write_mcap`.
    """
    mcap_format(path)
    robot, targets = motion.robot, motion.targets
    snapshots = [robot.snapshot(q) for q in motion.q]
    joints = np.array([one.joint_positions for one in snapshots])
    topics = [
        Topic("/joints/position", robot.joint_names, joints),
        Topic("/joints/velocity", robot.joint_names, motion.v[:, 6:]),
        Topic("/joints/torque", robot.joint_names, motion.torque),
        Topic("/com", XYZ, motion.whole.com),
        Topic("/angular_momentum", XYZ, motion.whole.momentum[:, 3:]),
        Topic("/human/com", XYZ, targets.human_com),
        Topic("/human/angular_momentum", XYZ, targets.angular_momentum),
        Topic("/cop", XYZ[:2], motion.cop),
        *(
            Topic(f"/forces/{side}", WRENCH, motion.wrenches[:, n])
            for n, side in enumerate(("left", "right"))
        ),
    ]
    summary = {"source": motion.source, "robot": robot.name, "notes": list(motion.notes)}
    return _write(path, snapshots, motion.time, topics, summary)


def _write(
    path: str | Path,
    snapshots: Sequence[Snapshot],
    times: Array,
    topics: Sequence[Topic],
    summary: Mapping[str, Any],
) -> Path:
    from mcap.writer import Writer

    stamps = [round(NANO * float(t)) for t in times]
    file = io.BytesIO()
    writer = Writer(file)
    writer.start(profile="", library=f"wbc {__version__}")
    schema = writer.register_schema(TRANSFORMS, "jsonschema", _text(transforms_schema()))
    channels = {"/tf": writer.register_channel("/tf", "json", schema)}
    for topic in topics:
        schema = writer.register_schema(
            f"wbc{topic.name.replace('/', '.')}", "jsonschema", _text(numbers_schema(topic))
        )
        channels[topic.name] = writer.register_channel(topic.name, "json", schema)
    for k, stamp in enumerate(stamps):
        writer.add_message(channels["/tf"], stamp, _text(transforms(snapshots[k], stamp)), stamp)
        for topic in topics:
            writer.add_message(channels[topic.name], stamp, _text(numbers(topic, k)), stamp)
    problem = summary.get("problem") or {}
    if problem.get("text"):
        text = str(problem["text"]).encode()
        writer.add_attachment(stamps[0], stamps[0], "problem.yaml", "application/yaml", text)
    writer.add_metadata("wbc", {key: json.dumps(value) for key, value in summary.items()})
    writer.finish()
    write_whole(Path(path), lambda out: out.write(file.getvalue()))
    return Path(path)


# ---------------------------------------------------------------------- what there is


def _of_run(
    snapshots: Sequence[Snapshot], history: History, summary: Mapping[str, Any]
) -> Iterator[Topic]:
    robot = snapshots[0].robot
    joints = np.array([one.joint_positions for one in snapshots])
    yield Topic("/joints/position", robot.joint_names, joints)
    yield Topic("/joints/velocity", robot.joint_names, history.v[:, 6:])
    yield Topic("/com", XYZ, np.array([one.com for one in snapshots]))
    tasks = summary.get("tasks") or {}
    for name, errors in history.errors.items():
        values = errors.reshape(len(errors), -1)
        rows = tuple((tasks.get(name) or {}).get("rows") or ())
        if len(rows) != values.shape[1]:
            rows = tuple(str(k) for k in range(values.shape[1]))
        yield Topic(f"/errors/{name}", rows, values)
    if history.clearance:
        left = np.column_stack(list(history.clearance.values()))
        yield Topic("/clearance", tuple(history.clearance), left)


def _of_simulation(robot: Robot, arrays: Mapping[str, NDArray[Any]]) -> Iterator[Topic]:
    for name, values in arrays.items():
        if name == "torque":
            yield Topic("/joints/torque", robot.joint_names, values)
        elif name.startswith("forces/"):
            yield Topic(f"/{name}", WRENCH, values)
        elif name == "cop":
            yield Topic("/cop", XYZ, values)


# ---------------------------------------------------------------------- messages


def transforms(snapshot: Snapshot, stamp: int) -> dict[str, Any]:
    """Return where the robot's frames are."""
    when = {"sec": stamp // NANO, "nsec": stamp % NANO}
    # A link called as the world is at it: a frame below itself is a cycle.
    names = [name for name in snapshot.robot.frame_names if name != WORLD]
    turns = Rotation.from_matrix([snapshot.rotation(name) for name in names]).as_quat()
    return {
        "transforms": [
            {
                "timestamp": when,
                "parent_frame_id": WORLD,
                "child_frame_id": name,
                "translation": dict(zip(XYZ, snapshot.position(name).tolist(), strict=True)),
                "rotation": dict(zip(XYZW, turn, strict=True)),
            }
            for name, turn in zip(names, turns.tolist(), strict=True)
        ]
    }


def _object(properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": dict(properties)}


def transforms_schema() -> dict[str, Any]:
    """Return the JSON schema of ``foxglove.FrameTransforms``."""
    number, text = {"type": "number"}, {"type": "string"}
    when = _object({"sec": {"type": "integer"}, "nsec": {"type": "integer"}})
    one = _object(
        {
            "timestamp": when,
            "parent_frame_id": text,
            "child_frame_id": text,
            "translation": _object(dict.fromkeys(XYZ, number)),
            "rotation": _object(dict.fromkeys(XYZW, number)),
        }
    )
    return {"title": TRANSFORMS, **_object({"transforms": {"type": "array", "items": one}})}


def numbers(topic: Topic, k: int) -> dict[str, float | None]:
    """Return the numbers of a topic at tick ``k``, by name; what is not finite is None."""
    values = (value if math.isfinite(value) else None for value in topic.values[k].tolist())
    return dict(zip(topic.entries, values, strict=True))


def numbers_schema(topic: Topic) -> dict[str, Any]:
    """Return the JSON schema of a topic's messages."""
    return _object({name: {"type": ["number", "null"]} for name in topic.entries})


def _text(message: Any) -> bytes:
    return json.dumps(message, allow_nan=False).encode()
