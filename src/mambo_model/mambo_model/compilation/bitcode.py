"""
Compile functions that only compiled code calls as far as their callers need them.

numba ends every function in machine code, and makes that of a caller from LLVM's bitcode of all
that it calls. The machine code of a function that Python never calls is thrown away. Such
functions end in bitcode here, which leaves a seventh less to compile for a flight. Some of them
are kept out of their callers, and calls from Python are not optimized.

numba has no public way to do this. What is used beyond ``pipeline_class`` are the libraries of
``numba.core.codegen`` and the cache of ``numba.core.caching``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import gc
from typing import Any

from llvmlite.ir import GlobalVariable
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.cgutils import voidptr_t
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_machinery import PassManager

_SELDOM = (100_000, 50, 50)  # new objects, younger and middle collections between collections


class BitcodeLibrary(JITCodeLibrary):
    """Optimized code of a function and of all that it calls, without machine code."""

    @classmethod
    def read(cls, context: Any, name: str, bitcode: bytes) -> BitcodeLibrary:
        """Return a library of a target context from its bitcode."""
        library = cls(context.codegen(), name)
        library._shared_module = library._final_module = ll.parse_bitcode(bitcode)
        library._finalize_final_module()
        return library

    def _finalize_final_module(self) -> None:
        """End with the bitcode, and with a place for the globals that callers look up by name."""
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        module = self._codegen._create_empty_module(self.name)
        for variable in self._final_module.global_variables:
            if (variable.name.startswith('_ZN08NumbaEnv')
                    and not self._codegen._engine.is_symbol_defined(variable.name)):
                place = GlobalVariable(module, voidptr_t, variable.name)
                place.linkage, place.initializer = 'common', voidptr_t(None)
        if module.global_values:
            self._codegen._add_module(ll.parse_assembly(str(module)))
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, as there is no machine code, of a library that is complete from here on."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return name and bitcode, for :meth:`read`."""
        return self.name, self._get_module_for_linking().as_bitcode()


class ApartLibrary(BitcodeLibrary):
    """The same of a function that LLVM does not copy into its callers."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Take the code of the function, with an attribute that keeps it whole."""
        for function in ir_module.functions:
            if not function.is_declaration and 'alwaysinline' not in function.attributes:
                function.attributes.add('noinline')
        super().add_ir_module(ir_module)


class PythonLibrary(JITCodeLibrary):
    """
    Machine code of a function that Python calls.

    Code that takes a call from Python apart, number by number, is not optimized: it runs once for
    a whole flight, and is a fifth of what is compiled for one.
    """

    def add_ir_module(self, ir_module: Any) -> None:
        """Take the code of the function, or that of the calls from Python."""
        for function in ir_module.functions:
            if not function.is_declaration and function.name.startswith('_ZN7cpython'):
                function.attributes.add('noinline')  # optnone asks for it
                function.attributes.add('optnone')
        super().add_ir_module(ir_module)


class InsideCompiler(Compiler):
    """numba's compiler, into a :class:`BitcodeLibrary`: for functions inside compiled code."""

    library = BitcodeLibrary

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's passes; blocks of Python inside a function end in machine code."""
        if not self.state.flags.force_pyobject:
            self.state.library = self.library(
                self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class ApartCompiler(InsideCompiler):
    """The same, into an :class:`ApartLibrary`."""

    library = ApartLibrary


@contextlib.contextmanager
def seldom_collected() -> Iterator[None]:
    """
    Let Python's garbage collector look less often.

    A tenth of the time to compile a flight goes into it otherwise, as numba makes millions of
    objects, and keeps most of them until it is done.
    """
    before = gc.get_threshold()
    gc.set_threshold(*_SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*before)


class PythonCompiler(Compiler):
    """numba's compiler, into a :class:`PythonLibrary`: for functions that Python calls."""

    def compile_extra(self, func: Callable) -> CompileResult:
        """Compile a function, and all that it calls."""
        with seldom_collected():
            return super().compile_extra(func)

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's passes."""
        self.state.library = PythonLibrary(
            self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class _Context:
    """A target context that reads a library from bitcode."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> _Context:
        """Return what reads libraries."""
        return self

    def unserialize_library(self, data: tuple[str, bytes]) -> BitcodeLibrary:
        """Return the library of :meth:`BitcodeLibrary.serialize_using_object_code`."""
        return BitcodeLibrary.read(self._context, *data)


class _InsideResults(CompileResultCacheImpl):
    """Reads functions with a :class:`BitcodeLibrary` from files."""

    def rebuild(self, target_context: Any, payload: tuple) -> CompileResult:
        """Return a function as it was compiled."""
        result = CompileResult._rebuild(_Context(target_context), *payload)
        return result._replace(target_context=target_context)


class InsideCache(FunctionCache):
    """Cache of a function that was compiled by :class:`InsideCompiler`."""

    _impl_class = _InsideResults
