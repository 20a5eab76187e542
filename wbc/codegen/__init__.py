"""A problem's controller as C, for use without Python: the native core, its plan written out."""

from wbc.codegen.export import export_problem
from wbc.codegen.known import CodegenError

__all__ = ["CodegenError", "export_problem"]
