"""Pictures of robots and of runs, by Matplotlib; and the live viewer, by viser.

Each is loaded when first used, so that neither needs the other's library.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wbc.extras import require

if TYPE_CHECKING:
    from wbc.view.history import HistoryLike
    from wbc.view.live.viewer import Viewer
    from wbc.view.pendulum import pendulum_figure, plot_pendulum
    from wbc.view.robots import plot_robot, robot_figure
    from wbc.view.run import plot_run, run_figure

__all__ = [
    "HistoryLike",
    "Viewer",
    "pendulum_figure",
    "plot_pendulum",
    "plot_robot",
    "plot_run",
    "robot_figure",
    "run_figure",
]

_PICTURES = {
    "HistoryLike": "wbc.view.history",
    "pendulum_figure": "wbc.view.pendulum",
    "plot_pendulum": "wbc.view.pendulum",
    "plot_robot": "wbc.view.robots",
    "plot_run": "wbc.view.run",
    "robot_figure": "wbc.view.robots",
    "run_figure": "wbc.view.run",
}
_LIVE = {"Viewer": "wbc.view.live.viewer"}


if not TYPE_CHECKING:  # to a checker, a module with this function has every name

    def __getattr__(name: str) -> Any:
        if name in _PICTURES:
            require("matplotlib", f"wbc.view.{name}")
            return getattr(import_module(_PICTURES[name]), name)
        if name in _LIVE:
            require("viser", f"wbc.view.{name}")
            return getattr(import_module(_LIVE[name]), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
