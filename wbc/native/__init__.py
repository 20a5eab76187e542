"""The optional native core: the arithmetic of a tick in C99, in the wheel or compiled on first use.

Everything works without it, and gives the same answers to rounding: what the core does not know, it
hands back. The environment variable ``WBC_NATIVE`` says ``auto`` (the default: where it can be
had), ``off``, or ``require`` (a typed error where it cannot); ``wbc doctor`` says which path runs.
"""

from wbc.native.build import NativeCoreError
from wbc.native.library import VARIABLE, Core, core, mode, status
from wbc.native.memory import address

__all__ = ["VARIABLE", "Core", "NativeCoreError", "address", "core", "mode", "status"]
