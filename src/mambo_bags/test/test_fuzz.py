"""A few hundred damaged files of a fixed seed; fuzzing.py tries thousands."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

FUZZING = Path(__file__).with_name('fuzzing.py')


@pytest.mark.parametrize('kind, count', [('bag', 40), ('yaml', 200), ('mat', 60)])
def test_damaged_files_end_well_or_in_one_line(tmp_path, kind, count):
    done = subprocess.run(
        [sys.executable, str(FUZZING), kind, str(count), '1', str(tmp_path)], text=True,
        capture_output=True, timeout=280,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output['wrong'] == []
    assert sum(output['outcomes'].values()) == count and len(output['outcomes']) > 1
