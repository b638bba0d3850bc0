"""CasADi expressions as compiled kernels, without a C compiler: for plants, laws and identified models.

`translate` prints an expression as Python source, `compile` keeps the source in a cache folder and compiles it with
Numba; `rigid_body` writes the dynamics of a serial arm as expressions.
"""

from qrobot.codegen.compile import CompiledFunction, compile_function
from qrobot.codegen.opcodes import QUICK_EXPRESSIONS

__all__ = ["QUICK_EXPRESSIONS", "CompiledFunction", "compile_function"]
