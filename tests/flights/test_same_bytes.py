"""Flights are the same to the last bit on every machine, compiled or not."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import same_bytes  # noqa: E402 (a tool, no package)

KNOWN = json.loads(same_bytes.DIGESTS.read_text())
STALE = 'after a change of what is flown: tools/same_bytes.py --write'


def test_the_flights_of_this_process_have_the_committed_digests():
    assert same_bytes.digests() == KNOWN, STALE


@pytest.mark.parametrize('surroundings', [
    {'NUMBA_DISABLE_JIT': '1'},
    {'NUMBA_DISABLE_JIT': '1', 'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX512F',
     'NPY_DISABLE_CPU_FEATURES': 'AVX2 FMA3 AVX512F AVX512CD AVX512_SKX'},
    {'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX512F'},
], ids=['no compiler', 'no compiler, an old processor', 'an old C library'])
def test_other_surroundings_have_them_too(surroundings):
    done = subprocess.run(
        [sys.executable, ROOT / 'tools/same_bytes.py'], env={**os.environ, **surroundings},
        capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count('the same') == len(KNOWN)


def test_a_digest_shows_the_last_bit(monkeypatch):
    monkeypatch.setattr(same_bytes, 'FLIGHTS', {
        'kalman': ({}, {'sim_node.simulator.wind.velocity': (5e-324, 0.0, 0.0)}),
        'other': ({'seed': 2}, {})})
    assert len({KNOWN['kalman'], *same_bytes.digests().values()}) >= 2
