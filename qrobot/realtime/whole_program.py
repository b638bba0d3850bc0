"""Machine code made once for each kernel that Python calls, of the whole program below that kernel.

Numba optimises a kernel, makes its machine code and two wrappers for callers from Python and C; then the kernels that
call it take in what came out and optimise it again, and so on upwards. Of the three hundred kernels of a servo cycle
Python calls one. Here a kernel has two halves:

- the *entry* is called from Python or through a pointer: linked with all it needs, optimised and compiled once;
- the *callee* is called from other kernels: types and LLVM's intermediate code, nothing more.

A *part* (`separate`) is called both ways and linked into none of its callers, see `separate_part`.

A kernel that is called both ways passes Numba's front end twice, some fifty milliseconds. Literal arguments are widened
first: a callee would be compiled anew for each fault code it is handed, and inlining finds the constants anyway.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any, Final

import llvmlite.binding as llvm
from numba import types
from numba.core import compiler, typed_passes, typing, untyped_passes
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import ForceLiteralArg, TypingError
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps

from qrobot.realtime.compile_progress import begin_entry, begin_kernel
from qrobot.realtime.remembered import remember_answers
from qrobot.realtime.separate_part import parts_in, stand_apart
from qrobot.realtime.source_digest import source_stamp

SELDOM: Final = 100_000, 50, 100  # objects, then looks at the younger generation
STACK_SLOTS: Final = 140_000  # a little more than a megabyte: the next chunk of Python's stack has two


class _KernelFlags(compiler.Flags):  # type: ignore[misc]
    """Compiler flags whose copies are one object: a copy is Numba's key at each look-up, and there are forty flags."""

    _FIXED: Final[dict[str, _FixedFlags]] = {}

    def copy(self) -> _FixedFlags:
        return self._FIXED.setdefault(self.summary(), _FixedFlags(self))


class _FixedFlags(compiler.Flags):  # type: ignore[misc]
    """Flags that nobody changes any more."""

    def __init__(self, flags: compiler.Flags) -> None:
        super().__init__(flags)
        self._values["hash"] = super().__hash__()

    def __hash__(self) -> int:
        return int(self._values["hash"])

    def __eq__(self, other: object) -> bool:
        return self is other or super().__eq__(other)

    def copy(self) -> compiler.Flags:
        flags = compiler.Flags(self)
        flags._values.pop("hash")
        return flags


class _Types(tuple[Any, ...]):
    """Argument types that are not spelt out: Numba would do it at each of its passes, and those of records are long."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{len(self)} arguments"


class _CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The intermediate code of one kernel."""

    _shared_module: Any
    _linking_libraries: list[Any]

    def __init__(self, codegen: Any, name: str) -> None:
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries, self._shared_module = [], None

    def add_llvm_module(self, module: Any) -> None:
        """Take the one module there is as it is: an empty one to link it into would have to be read first."""
        module.data_layout = self._codegen._data_layout
        self._final_module = module

    @property
    def codegen(self) -> Any:
        """Receiver of the environment of a function, which has no address here."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Leave it to the entry."""

    def get_pointer_to_function(self, _name: str) -> int:
        """Zero, which Numba takes for a function without a wrapper."""
        return 0

    def finalize(self) -> None:
        """Let others take the functions in; nothing is optimised yet."""
        self._finalize_dynamic_globals()
        _hand_out(self._final_module)
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Link with everything it calls a function that is compiled by Numba alone."""
        if self._shared_module is None:
            self._shared_module = self._final_module.clone()
            for library in _all_behind(self._linking_libraries):
                self._shared_module.link_in(_module_of(library), preserve=True)
        return self._shared_module


class _EntryLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A kernel with all it calls, as machine code."""

    _shared_module: Any
    _linking_libraries: list[Any]

    def finalize(self) -> None:
        """Take in each callee once, then go Numba's way."""
        direct, self._linking_libraries = self._linking_libraries, []
        for library in _all_behind(direct):
            self._reload_init.update(library._reload_init)
            self._reload_init.update(parts_in(library))
            self._final_module.link_in(_module_of(library), preserve=True)
        _keep_in(self._final_module)
        super().finalize()
        for variable in self._final_module.global_variables:
            if environment := compiler.lookup_environment(variable.name):
                self._codegen.set_env(variable.name, environment)

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _get_module_for_linking(self) -> Any:
        """Names alone, which are kept beside the machine code: nobody links an entry, kernels call the callee."""
        if self._shared_module is not None:
            return self._shared_module
        names = (f.name for f in self._final_module.functions if f.linkage == llvm.Linkage.external)
        return llvm.parse_assembly("\n".join(f'define void @"{name}"() {{ ret void }}' for name in names))


def _hand_out(module: Any) -> None:
    """Let functions be defined in several modules, and left out where nobody calls them."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == llvm.Linkage.external:
            function.linkage = "linkonce_odr"


def _keep_in(module: Any) -> None:
    """Let no other entry meet the functions that were taken in: of two with one name it would get the first."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
            function.linkage = "internal"


def _all_behind(libraries: list[Any]) -> Iterator[Any]:
    """Yield the libraries and those that they call, each once."""
    seen, waiting = set(), list(reversed(libraries))
    while waiting:
        library = waiting.pop()
        if library not in seen:
            seen.add(library)
            yield library
            if isinstance(library, _CalleeLibrary):
                waiting += reversed(library._linking_libraries)


def _module_of(library: Any) -> Any:
    """LLVM module of a library to link: of a callee itself alone."""
    return library._final_module if isinstance(library, _CalleeLibrary) else library._get_module_for_linking()


# Blocks in object mode, and a report on parallel loops: no kernel has them.
NEVER: Final = frozenset({untyped_passes.WithLifting, typed_passes.DumpParforDiagnostics})
# For functions inside a function and arrays made of comprehensions; and for operations on arrays that make an array.
ONLY_WITH_MEMORY: Final = frozenset(
    {untyped_passes.InlineClosureLikes, untyped_passes.MakeFunctionToJitFunction, typed_passes.NopythonRewrites}
)


def _needless(state: Any) -> frozenset[Any]:
    """Passes that would leave this kernel as it is."""
    names_function = any(isinstance(constant, CodeType) for constant in state.func_id.code.co_consts)
    return NEVER if state.flags.nrt or names_function else NEVER | ONLY_WITH_MEMORY


class _KernelCompiler(compiler.Compiler):  # type: ignore[misc]
    """Numba's compiler, without what no kernel needs and costs time at each of the three hundred."""

    library: type[JITCodeLibrary]

    def __init__(self, typing_context: Any, context: Any, library: Any, args: Any, *rest: Any) -> None:
        returns, flags, variables = rest
        super().__init__(typing_context, context, library, _Types(args), returns, _KernelFlags(flags), variables)

    def define_pipelines(self) -> Any:
        """Numba's passes as far as the kernel needs them, into our library."""
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        (passes,) = super().define_pipelines()
        passes.passes = [each for each in passes.passes if each[0] not in _needless(state)]
        return [passes]


class EntryCompiler(_KernelCompiler):
    """Makes machine code, for `numba.njit(pipeline_class=...)`."""

    library = _EntryLibrary

    def define_pipelines(self) -> Any:
        """The same, with all it calls, under a name of its own."""
        identity = self.state.func_id
        begin_entry(_told_below(identity.func))
        identity.unique_id = f"{_digest_of(identity.func, tuple.__repr__(self.state.args))}n{identity.unique_id}"
        identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        return super().define_pipelines()


class _CalleeCompiler(_KernelCompiler):
    """Makes intermediate code without wrappers."""

    library = _CalleeLibrary

    def define_pipelines(self) -> Any:
        """The same, into the other library."""
        begin_kernel(told_name(self.state.func_id.func))
        self.state.flags.no_cpython_wrapper = self.state.flags.no_cfunc_wrapper = True
        return super().define_pipelines()


class _Callee(CPUDispatcher):  # type: ignore[misc]
    """The half of a kernel that other kernels call."""

    def compile(self, arguments: tuple[Any, ...]) -> None:
        """Compile for these types. Without Numba's timers: each level of calls would add one that hears all others."""
        if arguments not in self.overloads:
            with self._compiling_counter:
                self.add_overload(self._compiler.compile(arguments, None))

    def add_overload(self, result: Any) -> None:
        """Keep it for kernels; from Python there is nothing to call."""
        self.overloads[tuple(result.signature.args)] = result

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Typing template of a call with these types. Raises Numba's errors."""
        signature, args = self._compiler.fold_argument_types(args, kws)
        try:
            self.compile(tuple(map(types.unliteral, args)))
        except (TypingError, ForceLiteralArg):  # it has to know a value, to index a tuple of several types for example
            self.compile(tuple(args))
        name = self.py_func.__name__
        return typing.make_concrete_template(name, name, self.nopython_signatures), signature, args, {}


def announce(entry: Any) -> None:
    """Count what has to be compiled for `entry`, whose parts are compiled first."""
    begin_entry(_told_below(entry.py_func))


def separate(entry: Any) -> None:
    """Let kernels call `entry` as a part with machine code of its own."""
    stand_apart(entry, lambda function: {told_name(each.py_func) for each in {entry, *callees_below(function)}})


def split(entry: Any) -> None:
    """Let kernels call the other half of `entry`, which was made with the `EntryCompiler`.

    That half is made when it is asked for: a process that finds its entries in the cache needs none of the others.
    """

    @cache
    def made() -> _Callee:
        return _Callee(entry.py_func, targetoptions=entry.targetoptions, pipeline_class=_CalleeCompiler)

    def callee() -> _Callee:
        with global_compiler_lock:
            return made()

    entry.callee = callee
    entry.get_call_template = lambda args, kws: callee().get_call_template(args, kws)
    entry.get_overload = lambda signature: callee().get_overload(signature)


def _digest_of(function: Any, arguments: str) -> str:
    """Sixteen digits that name an entry, whichever process compiled it.

    Numba numbers functions and records in the order in which a process meets them. Two parts out of the cache, which
    different processes compiled, could bear one name, and the loader would take one for the other.
    """
    path = Path(function.__code__.co_filename)
    source = source_stamp(path) if path.is_file() else function.__code__.co_code.hex()
    words = _written_in(function), function.__qualname__, source, arguments
    cells = dumps(tuple(cell.cell_contents for cell in function.__closure__ or ()))
    return hashlib.sha256("\n".join(words).encode() + cells).hexdigest()[:16]


def _told_below(function: Any) -> set[str]:
    """Names of the kernels that have to be compiled for it."""
    return {told_name(each.py_func) for each in callees_below(function) if not each.overloads}


def told_name(function: Any) -> str:
    """The name of a kernel for who waits for it."""
    return f"{_written_in(function).rpartition('.')[2]}.{function.__qualname__}"


def _written_in(function: Any) -> str:
    """Its Python module; empty for what was typed at a prompt."""
    return function.__module__ or ""


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Let Python look for garbage seldom: what the compiler makes lives on, and each look goes through all of it."""
    before = gc.get_threshold()
    gc.set_threshold(*SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def callees_below(function: Any) -> set[Any]:
    """Functions that a function calls, directly or not, as far as their names tell."""
    found: set[Any] = set()
    waiting = [function]
    while waiting:
        scope = inspect.getclosurevars(waiting.pop())
        named = (*scope.globals.values(), *scope.nonlocals.values())
        new = {half.callee() for half in named if hasattr(half, "callee")}
        waiting += [callee.py_func for callee in new - found]
        found |= new
    return found


def with_room(call: Callable[..., Any], *arguments: Any) -> Any:
    """Call something that goes hundreds of calls deep.

    Python's stack grows in chunks of 16 KiB and gives the last one back as soon as it is empty. A function called in a
    loop just where a chunk ends costs a chunk each time, new from the system: a fifth of all the time to compile.
    This frame says that it is large, so that those behind it share its chunk.
    """
    return call(*arguments)


remember_answers()
with_room.__code__ = with_room.__code__.replace(co_stacksize=STACK_SLOTS)
