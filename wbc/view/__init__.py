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

_FILES = {
    "HistoryLike": "history",
    "Viewer": "live.viewer",
    "pendulum_figure": "pendulum",
    "plot_pendulum": "pendulum",
    "plot_robot": "robots",
    "plot_run": "run",
    "robot_figure": "robots",
    "run_figure": "run",
}


if not TYPE_CHECKING:  # to a checker, a module with this function has every name

    def __getattr__(name: str) -> Any:
        if name in _FILES:
            require("viser" if name == "Viewer" else "matplotlib", f"wbc.view.{name}")
            return getattr(import_module(f"wbc.view.{_FILES[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
