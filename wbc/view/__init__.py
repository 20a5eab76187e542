"""Pictures of robots and of runs. The only folder that knows Matplotlib."""

from wbc.errors import WbcError

try:
    import matplotlib as _matplotlib  # noqa: F401
except ImportError as error:
    raise WbcError("pictures need Matplotlib; install it with: pip install 'wbc[plot]'") from error

from wbc.view.pendulum import pendulum_figure, plot_pendulum
from wbc.view.portrait import plot_robot, robot_figure
from wbc.view.run import History, plot_run, run_figure

__all__ = [
    "History",
    "pendulum_figure",
    "plot_pendulum",
    "plot_robot",
    "plot_run",
    "robot_figure",
    "run_figure",
]
