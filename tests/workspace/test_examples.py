"""The scripts of examples/ run as they stand, on the flight of the repository."""

from pathlib import Path
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

EXAMPLES = sorted((Path(__file__).parents[2] / 'examples').glob('*.py'))
SAYS = {'plot_a_bag': 'picture: circle_short.png', 'compare_two_bags': 'report: report.html',
        'sweep_and_look': 'picture: flights.png'}
ARGUMENTS = {'train_hover': ['6'],  # iterations, of 100
             'sweep_and_look': ['8']}  # flights, of 24
RISES = {'train_hover': (r'mean return +(\S+),', 3.0)}  # -4.0 to 1.2; a policy that falls has -4
FINDS = {'import_and_compare': (r'began (\S+) s into', 2.5, 0.02),  # the estimate lags by 9, 22 ms
         'identify_and_fly': (r'identify_thrust.yaml: (\S+) m below', 0.0, 0.01),
         'tune_the_estimator': (r'factor = constant: (\S+) m', 0.0153, 5e-5)}  # as recorded


@pytest.mark.long
@pytest.mark.parametrize('script', EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_writes_what_it_says(script, tmp_path):
    done = subprocess.run(
        [sys.executable, script, *ARGUMENTS.get(script.stem, [])], cwd=tmp_path, text=True,
        capture_output=True)
    assert done.returncode == 0, done.stderr
    if script.stem in SAYS:
        assert SAYS[script.stem] in done.stdout
        assert (tmp_path / SAYS[script.stem].split(': ')[1]).stat().st_size > 10_000
    if script.stem in FINDS:
        pattern, value, tolerance = FINDS[script.stem]
        assert float(re.search(pattern, done.stdout)[1]) == pytest.approx(value, abs=tolerance)
    if script.stem in RISES:
        pattern, least = RISES[script.stem]
        found = [float(value) for value in re.findall(pattern, done.stdout)]
        assert found[-1] > found[0] + least
