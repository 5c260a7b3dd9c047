"""A reader in a process of its own ends in time and stays within the limits of the user."""

import os
from pathlib import Path
import subprocess
import sys
import time

from mambo_analysis.importers import bounded
import pytest


def asleep(path):
    time.sleep(60.0)


def test_a_reader_that_takes_too_long_is_ended_and_the_limit_named(monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_READING_S', '1')
    began = time.monotonic()
    with pytest.raises(bounded.UnreadableError, match=r'1 s; MAMBO_MAX_READING_S \(now 1\)'):
        bounded.call(asleep, Path(__file__))
    assert time.monotonic() - began < 20.0


LIMITED = """
from pathlib import Path
import resource
from mambo_analysis.importers import bounded
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
print(bounded.call(lambda path: resource.getrlimit(resource.RLIMIT_AS), Path('/dev/null')))
"""


def test_a_limit_that_the_user_has_set_stays():
    done = subprocess.run([sys.executable, '-c', LIMITED], capture_output=True, text=True,
                          env={**os.environ, 'MAMBO_MAX_UNPACKED_MB': '4000'}, timeout=60)
    assert (done.stdout, done.stderr) == (f'{(6 << 30, 6 << 30)}\n', '')
