#!/usr/bin/env python3
"""
Build or serve the documentation site; make its pictures; install what that needs.

    python3 tools/docs.py build      into .cache/docs, strict: a dead link is an error
    python3 tools/docs.py serve      on http://127.0.0.1:8000, follows the files
    python3 tools/docs.py pictures   docs/images/*.svg, from the code
    python3 tools/docs.py install    requirements/docs.txt into .venv; build and serve do it too

In a shell of ``source env.bash``.
"""

from __future__ import annotations

import argparse
from importlib import metadata
import os
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENTS = ROOT / 'requirements/docs.txt'
SITE = ROOT / '.cache/docs'


class DocsError(Exception):
    """The site cannot be built here; the text says what to do."""


def installed() -> bool:
    """Return whether every package of the documentation is there in its version."""
    wanted = re.findall(r'^([\w-]+)==([\w.]+)', REQUIREMENTS.read_text(encoding='utf-8'),
                        re.MULTILINE)
    try:
        return all(metadata.version(name) == version for name, version in wanted)
    except metadata.PackageNotFoundError:
        return False


def install() -> None:
    """Install what the documentation needs, unless it is there."""
    if installed():
        return
    if sys.prefix == sys.base_prefix and 'VIRTUAL_ENV' not in os.environ:
        raise DocsError('this shell is not the environment of the project: source env.bash first')
    print('docs: installing MkDocs into .venv (once, some seconds)', file=sys.stderr)
    done = subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check',
         '-r', str(REQUIREMENTS)], text=True, capture_output=True)
    if done.returncode:
        reason = next((line for line in done.stderr.splitlines() if line.startswith('ERROR')),
                      'pip failed')
        raise DocsError(f'MkDocs could not be installed (no network?): {reason}')


def mkdocs(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run MkDocs on the site of the project: strict, and never quiet, which would be lenient."""
    install()
    return subprocess.run(
        [sys.executable, '-m', 'mkdocs', *arguments, '--strict', '-f', str(ROOT / 'mkdocs.yml')],
        cwd=ROOT, text=True, env={**os.environ, 'NO_MKDOCS_2_WARNING': '1'}, **options)


def pictures() -> int:
    """Make the pictures of the documentation anew."""
    install()
    from docs_pages import animation, graph
    folder = ROOT / 'docs/images'
    (folder / 'circle.svg').write_text(animation.svg(), encoding='utf-8')
    (folder / 'graph.svg').write_text(graph.svg(), encoding='utf-8')
    for path in sorted(folder.glob('*.svg')):
        print(f'picture: {path.relative_to(ROOT)} ({path.stat().st_size / 1000:.0f} kB)')
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Return the exit code of a command line."""
    parser = argparse.ArgumentParser(
        prog='docs', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=('build', 'serve', 'pictures', 'install'))
    options = parser.parse_args(arguments)
    try:
        if options.what == 'build':
            code = mkdocs('build', '--site-dir', str(SITE)).returncode
            if code == 0:
                print(f'site: {SITE / "index.html"}')
            return code
        if options.what == 'serve':
            return mkdocs('serve').returncode
        if options.what == 'pictures':
            return pictures()
        install()
    except DocsError as error:
        print(f'docs: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
