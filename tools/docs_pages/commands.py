"""The help of every command, taken from its own parser, and what each node is."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import subprocess
import sys

from mambo_bringup import mambo

from .source import docstring, ROOT, scripts

TOOLS = {
    './mambo': 'the command `mambo` from any shell',
    './run': 'the same as `mambo run`',
    './test': 'every test; `./test FILE ...` only these, `./test -k NAME` by name',
    './bench': 'speed, beside C and RotorPy',
    './chaos': 'inject faults into flights; each must end as it should',
    './mutants': 'break the equations one at a time and see whether a test notices'}


@contextlib.contextmanager
def _width(columns: int):
    before = os.environ.get('COLUMNS')
    os.environ['COLUMNS'] = str(columns)
    try:
        yield
    finally:
        if before is None:
            del os.environ['COLUMNS']
        else:
            os.environ['COLUMNS'] = before


def help_of(target: str) -> str:
    """Return what ``--help`` of a console script ``module:function`` prints."""
    module, function = target.split(':')
    output = io.StringIO()
    with _width(88), contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        getattr(importlib.import_module(module), function)(['--help'])
    return output.getvalue().rstrip()


def _fenced(text: str) -> list[str]:
    return ['```text', text, '```', '']


def commands() -> str:
    """Return a section for each command that is not a node."""
    out = ['### mambo', '', *_fenced(mambo.overview().rstrip())]
    verbs = {f'{entry.module}:main': name for name, entry in mambo.COMMANDS.items()}
    for target, names in sorted(scripts().items(), key=lambda item: min(item[1])):
        if target.split(':')[0].endswith('_node'):
            continue
        for name, owners in sorted(names.items()):
            title = name if target != 'mambo_bringup.run:main' else f'{name} in the graph'
            out += [f'### {title}', '', *_fenced(
                '\n'.join([f'mambo {verbs[target]}', *(
                    f'ros2 run {package} {name}' for package in owners)])),
                *_fenced(help_of(target))]
    return '\n'.join(out)


def nodes() -> str:
    """Return a section for each node."""
    out = []
    for target, names in sorted(scripts().items(), key=lambda item: min(item[1])):
        module = target.split(':')[0]
        for name, owners in sorted(names.items()) if module.endswith('_node') else ():
            out += [f'### {name}', '', docstring(module), '', *_fenced(
                '\n'.join(f'ros2 run {package} {name}' for package in owners))]
            if name not in ('check_node', 'composed_node', 'hall_capture_node'):
                out += [f'[Its parameters](parameters.md#{name})', '']
    return '\n'.join(out)


def tools() -> str:
    """Return the commands at the top of the checkout."""
    out = []
    for name, what in TOOLS.items():
        out += [f'### {name}', '', what[0].upper() + what[1:] + '.', '']
        if name in ('./bench', './chaos', './mutants'):
            script = (['-m', 'benchmarks'] if name == './bench' else
                      [f'tools/{name[2:]}.py'])
            out += _fenced(subprocess.run(
                [sys.executable, *script, '--help'], cwd=ROOT, text=True, capture_output=True,
                check=True,
                env={**os.environ, 'COLUMNS': '88', 'PYTHONPATH': os.pathsep.join(
                    [str(ROOT), os.environ.get('PYTHONPATH', '')])}).stdout.rstrip())
    return '\n'.join(out)
