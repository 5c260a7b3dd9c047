"""Functions inside compiled code: bitcode for their callers, and all that Python sees of them."""

import os
from pathlib import Path
import subprocess
import sys

from mambo_model.compilation.bitcode import BitcodeLibrary
from mambo_model.compiled import jit, jit_apart, jit_inside
import numba
from numba.core.registry import cpu_target
import pytest

SCRIPT = """
import numba
from mambo_model.compiled import jit, objmode

@jit
def inside(x):
    if x > 3.0:
        raise ValueError('above three', x)
    if x > 2.0:
        print('above two', x)
    return x

@jit
def asks(x):
    with objmode(x='float64'):
        x = float(str(-x))
    return inside(x)

@jit
def ours(x):
    return inside(x) + 1.0

@numba.njit
def theirs(x):
    return inside(x) + 1.0

@jit
def answered(x):
    return asks(x)

for caller in (ours, theirs, asks, answered):
    for x in (0.5, 2.5, 3.5, -2.5):
        try:
            print(caller(x), flush=True)
        except ValueError as error:
            print(error.args, flush=True)
"""
SAID = ['1.5', 'above two 2.5', '3.5', "('above three', 3.5)", '-1.5'] * 2 + [
    '-0.5', '-2.5', '-3.5', 'above two 2.5', '2.5'] * 2


@pytest.fixture(autouse=True, scope='module')
def nothing_from_the_cache():
    """Have everything below compiled here: what an earlier run left shows nothing."""
    for function in (twice, thrice, all_of_them, halved, quartered, parts, all_parts):
        for dispatcher in (function, function.for_python):
            dispatcher._cache.flush()


def engine_has(dispatcher):
    """Return whether machine code of a function's only signature is in numba's engine."""
    (result,) = dispatcher.overloads.values()
    return cpu_target.target_context.codegen()._engine.is_symbol_defined(
        result.fndesc.llvm_func_name)


@jit
def twice(x):
    return 2.0 * x


@jit_inside
def thrice(x):
    return 3.0 * x


@jit
def all_of_them(x):
    return twice(x) + thrice(x)


@numba.njit
def of_numba(x):
    return 4.0 * x


def test_of_functions_inside_there_is_no_machine_code():
    assert all_of_them(1.0) == 5.0 and of_numba(1.0) == 4.0
    for function in (twice, thrice):
        (result,) = function.overloads.values()
        assert isinstance(result.library, BitcodeLibrary)
        assert not engine_has(function)
    assert engine_has(of_numba)
    assert not all_of_them.overloads and all_of_them.for_python.overloads


@jit_apart
def halved(x):
    return 0.5 * x


@jit
def quartered(x):
    return 0.25 * x


@jit_inside
def parts(x):
    return halved(x) + quartered(x)


@jit
def all_parts(x):
    return parts(x) + halved(x)


def test_a_function_apart_is_called_and_what_is_compiled_for_one_inside_is_copied():
    assert all_parts(4.0) == 5.0
    (result,) = all_parts.for_python.overloads.values()
    code = result.library.get_llvm_str()
    (name,) = {result.fndesc.llvm_func_name for result in halved.overloads.values()}
    assert code.count(f'@{name}(') == 3  # defined once and called twice
    for function in (parts, quartered):
        (inside,) = function.overloads.values()
        assert f'@{inside.fndesc.llvm_func_name}(' not in code


def test_calls_from_python_are_not_optimized_and_the_function_is():
    assert all_parts(2.0) == 2.5
    (result,) = all_parts.for_python.overloads.values()
    code = result.library.get_llvm_str()
    lines = code.splitlines()
    (unoptimized,) = (line.split()[1] for line in lines
                      if line.startswith('attributes #') and 'optnone' in line)
    (wrapper,) = (line for line in lines if f' {unoptimized} ' in line and 'define' in line)
    assert f'@{result.fndesc.llvm_cpython_wrapper_name}(' in wrapper


@pytest.mark.long
def test_what_they_print_raise_and_ask_python_for_reaches_it_also_from_the_cache(tmp_path):
    script = tmp_path / 'script.py'
    script.write_text(SCRIPT)
    files = []
    environment = {name: value for name, value in os.environ.items() if name != 'NUMBA_CACHE_DIR'}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, script], env={**environment, 'MAMBO_CACHE_DIR': str(tmp_path)},
            capture_output=True, text=True, timeout=140, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines() == SAID
        files.append({path: path.stat().st_mtime_ns for path in Path(tmp_path).rglob('*.nbc')})
    assert files[0] == files[1] and any('inside' in path.parts for path in files[0])
