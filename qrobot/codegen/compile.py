"""Compiler of CasADi functions to kernels: the source goes to a cache folder, and Numba caches its code beside it.

The file is named by a digest of its contents, so a changed expression is another file, an unchanged one is compiled
once per machine, and kernels that call it stay cacheable. The folder is `$QROBOT_CACHE`, else `qrobot` in the user's
cache folder; whoever may write there can run code as the user, as with any cache of compiled Python.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qrobot.arrays import Floats
from qrobot.codegen.opcodes import EXPRESSIONS
from qrobot.codegen.translate import argument_names, scalar_function, translate
from qrobot.errors import CodegenError

if TYPE_CHECKING:
    import casadi


@dataclass(frozen=True)
class CompiledFunction:
    """A CasADi function as a kernel.

    Attributes:
        name: the function's.
        kernel: for other kernels. Takes contiguous float64 arrays of nonzeros, as many and as long as `sizes` says, and
            checks nothing.
        sizes: nonzeros by argument, in order: inputs, then outputs that do not overwrite an input.
        n_in: number of inputs among them.
        path: the generated source.
    """

    name: str
    kernel: Callable[..., None]
    sizes: Mapping[str, int]
    n_in: int
    path: Path

    def __call__(self, *inputs: Floats) -> tuple[Floats, ...]:
        """Evaluate from Python: the outputs, those in place excepted, as new arrays. Raises CodegenError on sizes."""
        wanted = list(self.sizes.values())
        if [np.size(argument) for argument in inputs] != wanted[: self.n_in]:
            raise CodegenError(f"{self.name} takes {dict(list(self.sizes.items())[: self.n_in])} numbers")
        outputs = tuple(np.zeros(size) for size in wanted[self.n_in :])
        with np.errstate(all="ignore"):  # as compiled code does, also with the JIT off
            self.kernel(*inputs, *outputs)
        return outputs


def compile_function(
    function: casadi.Function,
    in_place: Mapping[str, str] | None = None,
    cache_dir: Path | None = None,
    expressions: Mapping[str, str] = EXPRESSIONS,
    matrices: Collection[str] = (),
) -> CompiledFunction:
    """Make a kernel of a CasADi function; Numba compiles it at its first call.

    Args:
        function: of scalars (SX), or of matrices (MX) if it can be expanded. Its name is the kernel's.
        in_place: outputs that overwrite an input, as {output: input}: the step of a state.
        cache_dir: where the source goes; default the user's cache folder.
        expressions: what stands for CasADi's operations, `QUICK_EXPRESSIONS` for instance.
        matrices: inputs that come as arrays of rows, whose elements the function has row by row.

    Raises:
        CodegenError: the function cannot be translated, or the folder cannot be written.
    """
    function, in_place = scalar_function(function), in_place or {}
    source = translate(function, in_place, expressions, matrices)
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    path = (cache_dir or default_cache_dir()) / f"{function.name()}_{digest}.py"
    _keep(path, source)
    sizes = {name: function.nnz_in(name) for name in function.name_in()}
    sizes |= {name: function.nnz_out(name) for name in argument_names(function, in_place)[function.n_in() :]}
    return CompiledFunction(function.name(), _load(path, function.name()), sizes, function.n_in(), path)


def default_cache_dir() -> Path:
    """`$QROBOT_CACHE`, else `qrobot` under `$XDG_CACHE_HOME` or `~/.cache`; generated code has a folder of its own."""
    if own := os.environ.get("QROBOT_CACHE"):
        return Path(own) / "codegen"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qrobot" / "codegen"


def _keep(path: Path, source: str) -> None:
    """Make `path` hold `source`; whoever reads it meanwhile sees all of it or nothing."""
    try:
        if path.is_file() and path.read_text(encoding="utf-8") == source:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=path.parent, suffix=".new", delete=False) as file:
            file.write(source)
        os.replace(file.name, path)
    except OSError as error:
        raise CodegenError(f"cannot keep generated code in {path.parent} ({error}): set QROBOT_CACHE") from error


def _load(path: Path, name: str) -> Any:
    """The kernel `name` in the file; a file already loaded is not loaded again."""
    module_name = f"qrobot_generated.{path.stem}"
    module = sys.modules.get(module_name)
    if module is None or module.__file__ != str(path):
        spec = importlib.util.spec_from_file_location(module_name, path)
        if spec is None or spec.loader is None:
            raise CodegenError(f"{path} is no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module  # where Numba finds the code of a cached kernel
        spec.loader.exec_module(module)
    return getattr(module, name)
