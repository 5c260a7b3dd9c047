"""
Compile functions that only compiled code calls as far as their callers need them.

numba ends every function in machine code, and makes that of a caller from LLVM's bitcode of all
that it calls. The machine code of a function that Python never calls is thrown away. Such
functions end in bitcode here, which leaves a seventh less to compile for a flight.

numba has no public way to do this. What is used beyond ``pipeline_class`` are the libraries of
``numba.core.codegen`` and the cache of ``numba.core.caching``.
"""

from __future__ import annotations

from typing import Any

from llvmlite.ir import GlobalVariable
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.cgutils import voidptr_t
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_machinery import PassManager


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


class InsideCompiler(Compiler):
    """numba's compiler, into a :class:`BitcodeLibrary`: for functions inside compiled code."""

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's passes; blocks of Python inside a function end in machine code."""
        if not self.state.flags.force_pyobject:
            self.state.library = BitcodeLibrary(
                self.state.targetctx.codegen(), self.state.func_id.func_qualname)
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
