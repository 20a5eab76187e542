"""Types of tasks and constraints in problem files, registered on import.

Each file here describes the keys of one or several types, and builds them: subclasses of
:class:`~wbc.problem.task_spec.TaskSpec` or :class:`~wbc.problem.constraint_spec.ConstraintSpec`
whose ``type`` is its name in problem files.
"""

from importlib import import_module
from pkgutil import iter_modules

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
