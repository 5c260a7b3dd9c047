"""The notebooks of examples/ run from the first cell to the last, and are kept without output."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

NOTEBOOKS = sorted((Path(__file__).parents[2] / 'examples/notebooks').glob('*.ipynb'))
RUN = """
import ast, json, sys
import matplotlib
matplotlib.use('Agg')
names = {'__name__': '__main__'}
for cell in json.load(open(sys.argv[1]))['cells']:
    if cell['cell_type'] == 'code':
        tree = ast.parse(''.join(cell['source']))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, sys.argv[1], 'exec'), names)
        if last is not None:
            shown = eval(compile(ast.Expression(last.value), sys.argv[1], 'eval'), names)
            print(repr(shown))
"""


def test_there_is_one_for_each_use():
    assert {file.stem for file in NOTEBOOKS} >= {
        'fly_and_look', 'your_controller', 'your_estimator', 'sweep'}


@pytest.mark.long
@pytest.mark.parametrize('file', NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(file, tmp_path):
    done = subprocess.run(
        [sys.executable, '-c', RUN, file], cwd=file.parent, text=True, capture_output=True,
        timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip()


@pytest.mark.parametrize('file', NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_output(file):
    for cell in json.loads(file.read_text())['cells']:
        assert not cell.get('outputs') and cell.get('execution_count') is None
