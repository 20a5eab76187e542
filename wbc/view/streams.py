"""A run, live, in Foxglove or Rerun: what the recording holds, tick by tick.

    problem.run(show=FoxgloveStream(problem.parts.robot).show)

Foxglove connects to a WebSocket server here, at ws://localhost:8765; it draws the robot from its
URDF and ``/tf``, as of a recording. Rerun listens by itself; it is sent shapes and the ellipsoid.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError, UnknownNameError, WbcError
from wbc.extras import require
from wbc.rmp.ellipsoid import equimomental
from wbc.robot import Robot
from wbc.robot.geometry import RobotMeshes
from wbc.tasks.force_task import WRENCH
from wbc.validate import Array
from wbc.view.mcap_export import (
    NANO,
    XYZ,
    Topic,
    numbers,
    numbers_schema,
    transforms,
    transforms_schema,
)

FOXGLOVE_PORT, LAST_PORT = 8765, 65535
RERUN_PORT = 9876
RERUN_URL = f"rerun+http://127.0.0.1:{RERUN_PORT}/proxy"
FLUSH_TIME = 10.0  # s for sending the queue at the end: without a limit it blocks if nobody listens
# Rerun's queue holds about a thousand ticks; once it is full and nobody listens, logging blocks for
# ever, signals included. So a viewer is looked for before the run and every so often.
ANSWER_TIME, LOOK_TIME = 2.0, 0.5  # s: for an answer, between looks
GLASS = (120, 150, 220, 90)


class FoxgloveStream:
    """A WebSocket server for Foxglove; topics and messages are those of ``wbc export``.

    ``port``: that it listens at; 0 for any that is free.
    ``host``: that it is reached by; only this machine by default.

    Raises MissingPackageError: foxglove-sdk is not installed; InvalidInputError: the port cannot be
    had.
    """

    def __init__(self, robot: Robot, port: int = FOXGLOVE_PORT, host: str = "127.0.0.1") -> None:
        require("foxglove", "streaming to Foxglove")
        import foxglove

        self.robot = robot
        self._context, self._channels = foxglove.Context(), dict[str, Any]()
        self._channel: Callable[..., Any] = foxglove.Channel
        try:
            self._server = foxglove.start_server(
                name=f"wbc, {robot.name}", host=host, port=port, context=self._context
            )
        except (OSError, RuntimeError) as error:
            raise InvalidInputError(f"Foxglove, port {port}: {error}; name another one") from error
        self.where = f"Foxglove, Open connection: ws://{host}:{self._server.port}"
        self._channel_of("/tf", transforms_schema())

    def show(self, now: LoopTick, controller: Controller | None = None) -> None:
        """Send a tick."""
        stamp = round(NANO * now.time)
        self._send("/tf", transforms_schema(), transforms(now.snapshot, stamp), stamp)
        for topic in topics_of(now):
            self._send(topic.name, numbers_schema(topic), numbers(topic, 0), stamp)

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def _send(self, name: str, schema: dict[str, Any], message: dict[str, Any], stamp: int) -> None:
        self._channel_of(name, schema).log(message, log_time=stamp)

    def _channel_of(self, name: str, schema: dict[str, Any]) -> Any:
        if name not in self._channels:
            self._channels[name] = self._channel(name, schema=schema, context=self._context)
        return self._channels[name]


class RerunStream:
    """Sends ticks to a Rerun viewer, or into a file of Rerun's.

    ``to``: a viewer (``rerun`` starts one that listens), as ``HOST``, ``HOST:PORT`` or an address
    such as ``rerun+http://HOST:9876/proxy``; or a file ``*.rrd``.

    Raises MissingPackageError: rerun-sdk is not installed; InvalidInputError: the file cannot be
    written, it is no address, or nobody listens there.
    """

    def __init__(self, robot: Robot, to: str = RERUN_URL) -> None:
        require("rerun", "streaming to Rerun")
        import rerun

        self.robot, self.where, self._rerun = robot, f"Rerun: {to}", rerun
        self._out = rerun.RecordingStream("wbc")
        self._address: tuple[str, int] | None = None
        self._looked, self._is_gone = time.monotonic(), False
        try:
            if to.endswith(".rrd"):
                self._out.save(to)
            else:
                short = to if ":" in to else f"{to}:{RERUN_PORT}"
                address = to if "://" in to else f"rerun+http://{short}/proxy"
                parts = urlsplit(address)
                self._address = parts.hostname or "", parts.port or RERUN_PORT
                if not self._is_heard():  # Rerun would wait 11 s, and write of it
                    raise InvalidInputError(
                        f"stream 'rerun:{to}': nobody listens there; start a viewer first, by the"
                        " command rerun, or write a file: --stream rerun:run.rrd"
                    )
                self._out.connect_grpc(address)
        except (RuntimeError, ValueError) as error:  # of rerun: no such folder, no address
            raise InvalidInputError(
                f"stream 'rerun:{to}': {error}; name a viewer, as in rerun:HOST:{RERUN_PORT}, or a"
                " file that can be written, as in rerun:run.rrd"
            ) from error
        self._out.log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        shapes = RobotMeshes(robot).in_joint_frames
        self._joints = sorted({joint for joint, _ in shapes})
        for number, (joint, mesh) in enumerate(shapes):
            shape = rerun.Mesh3D(
                vertex_positions=mesh.vertices,
                triangle_indices=mesh.faces,
                albedo_factor=[*(round(255 * part) for part in mesh.colour), 255],
            )
            self._out.log(["robot", str(joint), f"{number} {mesh.name}"], shape, static=True)

    def show(self, now: LoopTick, controller: Controller | None = None) -> None:
        """Send a tick, unless the viewer is gone."""
        if time.monotonic() - self._looked > LOOK_TIME:
            self._looked = time.monotonic()
            self._is_gone = self._is_gone or not self._is_heard()
        if self._is_gone:
            return
        rerun, snapshot = self._rerun, now.snapshot
        self._out.set_time("time", duration=now.time)
        rotations, origins = snapshot.joint_placements
        for joint in self._joints:
            place = rerun.Transform3D(translation=origins[joint], mat3x3=rotations[joint])
            self._out.log(f"robot/{joint}", place)
        body = equimomental(snapshot.inertia, self.robot.mass)
        turn = Rotation.from_matrix(body.axes).as_quat()
        glass = rerun.Ellipsoids3D(
            centers=[snapshot.com],
            half_sizes=[body.semi_axes],
            quaternions=[rerun.Quaternion(xyzw=turn)],
            colors=[GLASS],
            fill_mode=rerun.components.FillMode.Solid,
        )
        self._out.log("ellipsoid", glass)
        for topic in topics_of(now):
            for entry, value in zip(topic.entries, topic.values[0].tolist(), strict=True):
                path = ["numbers", *topic.name[1:].split("/", 1), entry]
                self._out.log(path, rerun.Scalars(value))

    def close(self) -> None:
        """Send the queue, and end.

        Raises WbcError: not all was sent: nobody listens there, or the disk is full.
        """
        try:
            if self._is_gone:
                raise WbcError(f"{self.where}: not all was sent: the viewer was closed meanwhile")
            self._out.flush(timeout_sec=FLUSH_TIME)
        except RuntimeError as error:  # of rerun
            raise WbcError(f"{self.where}: not all was sent: {error}") from error
        finally:
            self._out.disconnect()

    def _is_heard(self) -> bool:
        """Return whether a viewer listens, or a file is written."""
        if self._address is None:
            return True
        try:
            socket.create_connection(self._address, ANSWER_TIME).close()
        except OSError:
            return False
        return True


def stream_of(robot: Robot, wanted: str) -> FoxgloveStream | RerunStream:
    """Return the stream asked for: ``foxglove[:PORT]``, or ``rerun[:HOST:PORT or FILE.rrd]``.

    Raises UnknownNameError, InvalidInputError: no such program; no port; MissingPackageError: its
    package is not installed.
    """
    name, _, rest = wanted.partition(":")
    if name == "foxglove":
        port = FOXGLOVE_PORT
        if rest:
            port = int(rest) if rest.isdecimal() else -1
            if not 0 <= port <= LAST_PORT:
                raise InvalidInputError(
                    f"stream {wanted!r}: expected a port from 0 to {LAST_PORT}, got {rest!r}"
                )
        return FoxgloveStream(robot, port)
    if name == "rerun":
        return RerunStream(robot, rest or RERUN_URL)
    raise UnknownNameError("stream", name, ("foxglove", "rerun"))


def topics_of(now: LoopTick) -> Iterator[Topic]:
    """Yield the numbers of one tick, each with one row of values, named as in a recording."""
    tick, snapshot = now.tick, now.snapshot
    joints = snapshot.robot.joint_names
    yield _topic("/joints/position", joints, snapshot.joint_positions)
    yield _topic("/joints/velocity", joints, tick.velocity[6:])
    yield _topic("/com", XYZ, snapshot.com)
    for name, error in tick.errors.items():
        yield _topic(f"/errors/{name}", tuple(map(str, range(error.size))), error)
    if isinstance(tick, TorqueTick):
        yield _topic("/joints/torque", joints, tick.torque)
        for frame, wrench in tick.forces.items():
            if wrench.size == len(WRENCH):  # not of a gear or a closed loop
                yield _topic(f"/forces/{frame}", WRENCH, wrench)
        if tick.cop is not None:
            yield _topic("/cop", XYZ, tick.cop)


def _topic(name: str, entries: tuple[str, ...], values: Array) -> Topic:
    return Topic(name, entries, np.asarray(values, dtype=float).reshape(1, -1))
