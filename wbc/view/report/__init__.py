"""A run as one HTML file that opens offline: replay in 3-D, plots, the problem and versions."""

from wbc.view.report.report import write_report

__all__ = ["write_report"]
