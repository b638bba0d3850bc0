"""Control laws as CasADi functions, out of Python functions of symbols.

Importing this module does not load CasADi; building a law does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from qrobot.config import Robot
from qrobot.errors import CodegenError

if TYPE_CHECKING:
    import casadi

NEXT_MEMORY = "next_memory"


def law_function(
    name: str,
    build: Callable[..., Any],
    wanted: tuple[str, ...],
    inputs: tuple[str, ...],
    sizes: Mapping[str, int],
    robot: Robot,
    n_gains: int,
) -> tuple[casadi.Function, dict[str, str]]:
    """Call `build` with symbols, and make a function of what it returns.

    Args:
        name: of the function.
        build: returns torques (n), or torques and the next memory.
        wanted: what it takes: some of `inputs`, `robot`, and `arm`, the robot's rigid-body model.
        inputs: of the function, all of them.
        sizes: of each input but `gains`.
        robot: whose law it is.
        n_gains: rows of `gains`.

    Returns:
        The function, and its outputs that overwrite an input. `gains` is flat, row by row.

    Raises:
        CodegenError: `build` fails, or returns something else.
    """
    import casadi

    from qrobot.codegen.rigid_body import serial_arm

    symbols = {
        key: casadi.SX.sym(key, robot.n, n_gains) if key == "gains" else casadi.SX.sym(key, sizes[key])
        for key in inputs
    }
    offered = symbols | {"gains": symbols["gains"].T, "robot": robot}
    if "arm" in wanted:
        offered["arm"] = serial_arm(robot)
    try:
        results = build(**{key: offered[key] for key in wanted})
    except Exception as error:  # whatever a user's function raises
        raise CodegenError(f"the expression cannot be built: {type(error).__name__}: {error}") from error
    outputs = _outputs(results, robot.n, sizes["memory"])
    in_place = {NEXT_MEMORY: "memory"} if NEXT_MEMORY in outputs else {}
    function = casadi.Function(
        name, list(symbols.values()), casadi.cse(list(outputs.values())), list(inputs), list(outputs)
    )
    return function, in_place


def _outputs(results: Any, n: int, n_memory: int) -> dict[str, Any]:
    import casadi

    found = results if isinstance(results, tuple) else (results,)
    wanted = dict(zip(("tau", NEXT_MEMORY), (n, n_memory), strict=True))
    if len(found) > len(wanted):
        raise CodegenError(
            f"it returns {len(found)} expressions: the torques, or the torques and the next memory are wanted"
        )
    outputs = {}
    for (name, size), value in zip(wanted.items(), found, strict=False):
        try:
            vector = casadi.densify(casadi.vec(casadi.SX(value)))
        except (TypeError, NotImplementedError) as error:
            raise CodegenError(f"{name} is {type(value).__name__}, not an expression of scalars (SX)") from error
        if vector.numel() != size:
            raise CodegenError(f"{name} has {vector.numel()} elements, {size} are wanted")
        outputs[name] = vector
    return outputs
