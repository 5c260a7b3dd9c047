"""Flights are the same to the last bit on every machine, compiled or not."""

import json
import math
import os
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import same_bytes  # noqa: E402 (a tool, no package)

KNOWN = json.loads(same_bytes.DIGESTS.read_text())
MASS = 0.068  # kg, of the vehicle that flies by default
STALE = 'after a change of what is flown: tools/same_bytes.py --write'


def test_the_compiled_flights_have_the_committed_digests():
    flown = same_bytes.digests(['kalman', 'support package'])
    assert flown.items() <= KNOWN.items(), STALE


OLD = {'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX512F',
       'NPY_DISABLE_CPU_FEATURES': 'AVX2 FMA3 AVX512F AVX512CD AVX512_SKX'}
PLAIN = {'NUMBA_DISABLE_JIT': '1'}


@pytest.mark.parametrize('surroundings, flights', [
    (PLAIN, list(KNOWN)), ({**PLAIN, **OLD}, list(KNOWN)), (OLD, ['kalman'])],
    ids=['no compiler', 'no compiler, old processor', 'old processor'])
def test_other_surroundings_have_them_too(surroundings, flights):
    done = subprocess.run(
        [sys.executable, ROOT / 'tools/same_bytes.py', *flights], timeout=300, check=False,
        env={**os.environ, **surroundings}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count('the same') == len(flights)


def test_another_last_bit_and_an_unknown_flight_fail(monkeypatch, capsys):
    monkeypatch.setitem(same_bytes.FLIGHTS, 'kalman', (
        {'estimator': 'kalman'}, {'sim_node.simulator.vehicle.mass': math.nextafter(MASS, 1.0)}))
    assert same_bytes.main(['kalman']) == 1 and 'DIFFERENT' in capsys.readouterr().out
    assert same_bytes.main(['none']) == 2


def test_what_is_flown_needs_no_ros():
    absent = ('rclpy', 'mambo_interfaces', 'std_msgs', 'sensor_msgs', 'diagnostic_msgs')
    done = subprocess.run(
        [sys.executable, '-c', 'import sys\n'
         f'sys.modules.update(dict.fromkeys({absent}))\n'
         'from mambo_flight import closed_loop\nfrom mambo_flight.scenario import scenario'],
        timeout=120, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
