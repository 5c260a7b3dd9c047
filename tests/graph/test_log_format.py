"""The runner reads the lines of its nodes, whatever the user's environment says of logging."""

import os
import subprocess
import sys

import pytest


@pytest.mark.long
def test_a_log_format_of_the_users_own_does_not_blind_the_runner(tmp_path):
    done = subprocess.run(
        [sys.executable, '-m', 'mambo_bringup.run', '--duration', '1', '--no-landing',
         '--no-report', '-o', str(tmp_path / 'bag')],
        capture_output=True, text=True, timeout=300,
        env={**os.environ, 'RCUTILS_CONSOLE_OUTPUT_FORMAT': '{message} in {function_name}',
             'RCUTILS_COLORIZED_OUTPUT': 'abc', 'RCUTILS_LOGGING_USE_STDOUT': '7'})
    assert done.returncode == 0 and done.stdout.startswith('flew 1.00 s in '), done
