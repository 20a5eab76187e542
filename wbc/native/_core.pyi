"""What cffi makes of source/core.h: functions, constants and structures in C."""

from typing import Any

ffi: Any
lib: Any
