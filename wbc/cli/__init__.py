"""The command line, ``wbc``."""

from wbc.cli.app import app, main

__all__ = ["app", "main"]
