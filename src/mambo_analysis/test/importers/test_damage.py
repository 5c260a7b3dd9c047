"""Damaged files of every kind: one line and exit code 1, or a bag; never anything else."""

import random

from damage import check, crazyflie, motive, mutated, reworded, simulink
from mambo_analysis.importers import (
    crazyflie as import_crazyflie, minidrone, motive as import_motive)
import pytest

MUTATIONS = 25


KINDS = {
    'minidrone': (minidrone.main, '.mat', lambda path: simulink(path, True), mutated, []),
    'plain minidrone': (
        minidrone.main, '.mat', lambda path: simulink(path, False), mutated, []),
    'crazyflie': (import_crazyflie.main, '.json', crazyflie, reworded, ['--mocap-offset', '0']),
    'motive': (import_motive.main, '.csv', motive, reworded, [])}


@pytest.mark.long
@pytest.mark.parametrize('kind', KINDS)
def test_a_damaged_file_gives_one_line_or_a_bag(kind, tmp_path, capfd):
    main, suffix, make, change, options = KINDS[kind]
    path, rng = tmp_path / f'file{suffix}', random.Random(kind)
    make(path)
    content = path.read_bytes()
    assert check(main, [str(path), *options], tmp_path / 'out', capfd)
    for _ in range(MUTATIONS):
        path.write_bytes(change(rng, content))
        check(main, [str(path), *options], tmp_path / 'out', capfd)
