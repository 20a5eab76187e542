"""Export of a problem's controller as C, for use without Python: the native core and its plan."""

from wbc.codegen.core_parts import CodegenError
from wbc.codegen.export import export_problem

__all__ = ["CodegenError", "export_problem"]
