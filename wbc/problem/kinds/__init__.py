"""Kinds of tasks and constraints, found by themselves.

A file here describes what a problem file says of a kind or of some, and makes them: subclasses of
:class:`~wbc.problem.task_spec.TaskSpec` or :class:`~wbc.problem.constraint_spec.ConstraintSpec`
whose ``type`` is its word in files.
"""

from importlib import import_module
from pkgutil import iter_modules

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
