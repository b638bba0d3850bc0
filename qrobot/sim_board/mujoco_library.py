"""MuJoCo's C functions, for kernels to call by the addresses of a model and its data.

They are resolved by name at link time, so that kernels which call them can be cached; a ctypes pointer could not.
"""

from __future__ import annotations

import ctypes
import importlib.util
from functools import cache
from pathlib import Path
from typing import Any, Final

import llvmlite.binding
from numba import types

from qrobot.errors import ConfigError
from qrobot.extras import missing_library
from qrobot.realtime.jit import jit_disabled

_ADDRESS: Final = types.intp
_NUMBER: Final = types.int32
_C_TYPES: Final = {_ADDRESS: ctypes.c_void_p, _NUMBER: ctypes.c_int}


def library_path() -> Path:
    """MuJoCo's shared library beside its Python package. Raises ConfigError when it is not installed."""
    found = importlib.util.find_spec("mujoco")
    if found is None or found.origin is None:
        raise ConfigError(missing_library("mujoco"))
    libraries = sorted(Path(found.origin).parent.glob("libmujoco.*"))
    if not libraries:
        raise ConfigError(f"no MuJoCo library beside {Path(found.origin).name}: reinstall mujoco-core")
    return libraries[0]


def link_library() -> None:
    """Make MuJoCo's functions known to the JIT's linker; needed once per process before a kernel steps a plant."""
    llvmlite.binding.load_library_permanently(str(library_path()))


@cache
def _loaded() -> ctypes.CDLL:
    return ctypes.CDLL(str(library_path()))


def _function(name: str, *arguments: Any) -> Any:
    """A function without a result; with the JIT off by ctypes."""
    if not jit_disabled():
        return types.ExternalFunction(name, types.void(*arguments))

    def call(*values: int) -> None:
        converted = [_C_TYPES[kind](int(value)) for kind, value in zip(arguments, values, strict=True)]
        getattr(_loaded(), name)(*converted)

    return call


# Of (model, data); see MuJoCo's "Simulation pipeline" for what each computes from what.
mj_step: Final = _function("mj_step", _ADDRESS, _ADDRESS)
mj_kinematics: Final = _function("mj_kinematics", _ADDRESS, _ADDRESS)
mj_com_pos: Final = _function("mj_comPos", _ADDRESS, _ADDRESS)
mj_com_vel: Final = _function("mj_comVel", _ADDRESS, _ADDRESS)
mj_make_mass: Final = _function("mj_makeM", _ADDRESS, _ADDRESS)
mj_factor_mass: Final = _function("mj_factorM", _ADDRESS, _ADDRESS)

# Of (model, data, with accelerations, result).
mj_rne: Final = _function("mj_rne", _ADDRESS, _ADDRESS, _NUMBER, _ADDRESS)

# Of (model, data, result, right side, number of right sides).
mj_solve_mass: Final = _function("mj_solveM", _ADDRESS, _ADDRESS, _ADDRESS, _ADDRESS, _NUMBER)
