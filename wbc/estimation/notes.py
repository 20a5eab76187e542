"""What the core notes of a message, in words: what was not believed, or not counted on."""

from __future__ import annotations

from wbc.errors import listed
from wbc.estimation.core import EstimatorCore
from wbc.native import lib

AGAIN = "not counted on until it is still"
# Of IMUs and feet, with the name and how much.
WORDS = {
    lib.RATE_BEYOND: "IMU {0!r}: angular velocity beyond its range of {1:g}; not used",
    lib.FORCE_BEYOND: "IMU {0!r}: specific force beyond its range of {1:g}; not used",
    lib.HANGS: "IMU {0!r}: {1:.0f} readings in a row are the same; not used",
    lib.LEFT_OUT: "IMU {0!r}: silent for {1:.0f} ms; left out",
    lib.HELD: "IMU {0!r}: held for {1:.0f} ms",
    lib.GAP: "IMU {0!r}: nothing for {1:.0f} ms, for which one reading stands",
    lib.COUNTED_ANYWAY: "no foot is still: {0} is counted on at {1:.2f} m/s",
    lib.SLIPS: f"{{0}} foot slips at {{1:.2f}} m/s; {AGAIN}",
    lib.ROLLS: "{0} foot turns by {1:.0f} mrad",
    lib.ROLLS_OVER: f"{{0}} foot turns by {{1:.0f}} mrad; {AGAIN}",
    lib.OUTSIDE: "{0} foot seen {1:.1f} mm off: an outlier, not used",
    lib.SLIPPED_OFF: f"{{0}} foot slips: seen {{1:.1f}} mm off; {AGAIN}",
    lib.FEET_APART: "{0} foot slips: feet are {1:.1f} mm nearer or farther; not counted on",
}
OF_IMUS = (lib.RATE_BEYOND, lib.FORCE_BEYOND, lib.HANGS, lib.LEFT_OUT, lib.HELD, lib.GAP)
NO_LOADS = "no contacts, forces or torques: all feet are taken to bear always"


Names = tuple[str, ...]  # in the core's order


def noted(core: EstimatorCore, imus: Names, joints: Names, feet: Names) -> tuple[str, ...]:
    """Return what was noted of the last message."""
    count = int(core.event[0])
    events = core.event[1 : 1 + 2 * count].reshape(count, 2).tolist()
    found, jumped = list[str](), list[str]()
    for (kind, whose), much in zip(events, core.detail[:count].tolist(), strict=True):
        if kind == lib.JOINT_JUMPED:
            jumped.append(joints[whose])
            continue
        if jumped:
            found.append(_held(jumped))
        if kind == lib.TAKES_OVER:
            silent, now = (imus[k] for k in divmod(whose, lib.MOST_IMUS))
            found.append(f"IMU {silent!r}: silent for {much:.0f} ms; {now!r} takes over")
        elif kind == lib.NO_LOADS:
            found.append(NO_LOADS)
        else:
            own = imus if kind in OF_IMUS else feet
            found.append(WORDS[kind].format(own[whose], much))
    if jumped:
        found.append(_held(jumped))
    return tuple(found)


def _held(jumped: list[str]) -> str:
    text = f"joint {listed(jumped)}: position jumped; held"
    jumped.clear()
    return text
