"""What the generated pages read from the source tree: packages, modules, console scripts, text."""

from __future__ import annotations

import ast
from pathlib import Path
import re

from .docstrings import markdown

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / 'src'


def packages() -> list[str]:
    """Return the names of the Python packages under ``src``."""
    return sorted(path.parent.name for path in SRC.glob('*/setup.py'))


def folders(package: str) -> dict[str, list[str]]:
    """Return {dotted name of a folder: dotted names of its modules} of a package."""
    root, out = SRC / package, {}
    for file in sorted((root / package).rglob('*.py')):
        name = '.'.join(file.relative_to(root).with_suffix('').parts)
        folder = '.'.join(file.relative_to(root).parent.parts)
        modules = out.setdefault(folder, [])
        if file.stem != '__init__':
            modules.append(name)
    return {folder: modules for folder, modules in out.items() if modules}


def scripts() -> dict[str, dict[str, list[str]]]:
    """Return {'module:function': {name: packages that install it}} of every console script."""
    out: dict[str, dict[str, list[str]]] = {}
    for package in packages():
        tree = ast.parse((SRC / package / 'setup.py').read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and (
                    found := re.fullmatch(r'(\w+) = ([\w.]+:\w+)', node.value)):
                out.setdefault(found[2], {}).setdefault(found[1], []).append(package)
    return out


def docstring(module: str) -> str:
    """Return the docstring of a module as Markdown, without importing it."""
    file = SRC / module.split('.')[0] / Path(*module.split('.'))
    file = file / '__init__.py' if file.is_dir() else file.with_suffix('.py')
    return markdown(ast.get_docstring(ast.parse(file.read_text(encoding='utf-8'))) or '')


def cell(text: object) -> str:
    """Return text that may stand in a cell of a Markdown table."""
    return str(text).replace('|', '\\|').replace('\n', ' ')


def table(head: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    """Return a Markdown table."""
    lines = [head, ('---',) * len(head), *rows]
    return '\n'.join(f'| {" | ".join(map(cell, line))} |' for line in lines)
