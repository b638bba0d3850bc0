"""CasADi's scalar operations as Python expressions; `_c` is `qrobot.codegen.scalar`. What is not here is refused.

Left out on purpose: `OP_ERFINV` (CasADi's own approximation), `OP_PRINTME` (output in a kernel), `OP_CALL` (a function
that stayed a function), `OP_PARAMETER` (a free symbol).
"""

from __future__ import annotations

from functools import cache
from typing import Final

EXPRESSIONS: Final[dict[str, str]] = {
    "OP_ADD": "{0} + {1}",
    "OP_SUB": "{0} - {1}",
    "OP_MUL": "{0} * {1}",
    "OP_DIV": "{0} / {1}",
    "OP_NEG": "-{0}",
    "OP_INV": "1.0 / {0}",
    "OP_SQ": "{0} * {0}",
    "OP_TWICE": "2.0 * {0}",
    "OP_EXP": "_c.exp({0})",
    "OP_EXPM1": "_c.expm1({0})",
    "OP_LOG": "_c.log({0})",
    "OP_LOG1P": "_c.log1p({0})",
    "OP_SQRT": "_c.sqrt({0})",
    "OP_POW": "_c.power({0}, {1})",
    "OP_CONSTPOW": "_c.power({0}, {1})",
    "OP_HYPOT": "_c.hypot({0}, {1})",
    "OP_SIN": "_c.sin({0})",
    "OP_COS": "_c.cos({0})",
    "OP_TAN": "_c.tan({0})",
    "OP_ASIN": "_c.asin({0})",
    "OP_ACOS": "_c.acos({0})",
    "OP_ATAN": "_c.atan({0})",
    "OP_ATAN2": "_c.atan2({0}, {1})",
    "OP_SINH": "_c.sinh({0})",
    "OP_COSH": "_c.cosh({0})",
    "OP_TANH": "_c.tanh({0})",
    "OP_ASINH": "_c.asinh({0})",
    "OP_ACOSH": "_c.acosh({0})",
    "OP_ATANH": "_c.atanh({0})",
    "OP_ERF": "_c.erf({0})",
    "OP_FABS": "_c.fabs({0})",
    "OP_SIGN": "_c.sign({0})",
    "OP_COPYSIGN": "_c.copysign({0}, {1})",
    "OP_FLOOR": "_c.floor({0})",
    "OP_CEIL": "_c.ceil({0})",
    "OP_FMOD": "_c.fmod({0}, {1})",
    "OP_REMAINDER": "_c.remainder({0}, {1})",
    "OP_FMIN": "_c.fmin({0}, {1})",
    "OP_FMAX": "_c.fmax({0}, {1})",
    "OP_LT": "_c.less({0}, {1})",
    "OP_LE": "_c.less_or_equal({0}, {1})",
    "OP_EQ": "_c.equal({0}, {1})",
    "OP_NE": "_c.differs({0}, {1})",
    "OP_NOT": "_c.logic_not({0})",
    "OP_AND": "_c.logic_and({0}, {1})",
    "OP_OR": "_c.logic_or({0}, {1})",
    "OP_IF_ELSE_ZERO": "_c.if_else_zero({0}, {1})",
}

# Sine and cosine to rounding instead of the C library's last bit, sharing their work, for steps of a plant.
QUICK_EXPRESSIONS: Final = EXPRESSIONS | {"OP_SIN": "_c.quick_sin({0})", "OP_COS": "_c.quick_cos({0})"}


@cache
def opcode_names() -> dict[int, str]:
    """CasADi's name of every operation by its number."""
    import casadi

    return {getattr(casadi, name): name for name in dir(casadi) if name.startswith("OP_")}
