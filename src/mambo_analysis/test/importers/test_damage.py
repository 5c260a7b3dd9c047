"""Damaged files of every kind: one line and exit code 1, or a bag; never anything else."""

import json
import random

from damage import check, mutated, reworded
from mambo_analysis.importers import (
    crazyflie as import_crazyflie, minidrone, motive as import_motive)
import numpy as np
import pytest
import scipy.io

MUTATIONS = 25


def block(values):
    return {'time': np.arange(len(values)) * 0.005, 'signals': {'values': values}}


def simulink(path, compressed):
    """Write a log with a signal for each scope."""
    rng, names = np.random.default_rng(1), ('a_x', 'a_y', 'a_z', 'p', 'q', 'r', 'pressure')
    scipy.io.savemat(path, {f'rt_{name}': block(
        rng.normal(size=200) - 9.8 * (name == 'a_z')) for name in names},
        do_compression=compressed)


def crazyflie(path):
    """Write a log of 40 samples."""
    times = [0.01 * i for i in range(40)]
    entry = {'time': times, 'data': [0.1 * i for i in range(40)]}
    names = ('w_x', 'w_y', 'w_z', 'a_z', 'r', 'n_x', 'n_y', 'm_1', 'm_2', 'm_3', 'm_4')
    path.write_text(json.dumps({
        'drone': {f'ae483log.{name}': entry for name in names},
        'mocap': {'time': times} | dict.fromkeys(import_crazyflie.MOCAP, times)}))


def motive(path):
    """Write a take of one rigid body and 30 frames."""
    axes = ['Rotation X', 'Rotation Y', 'Rotation Z', 'Rotation W', 'Position X', 'Position Y',
            'Position Z']
    head = [['', 'Type'] + ['Rigid Body'] * 7, ['', 'Name'] + ['Body'] * 7,
            ['', 'ID'] + ['CF51'] * 7, ['', ''] + [axis.split()[0] for axis in axes],
            ['Frame', 'Time (Seconds)'] + [axis.split()[1] for axis in axes]]
    rows = [[str(i), f'{i / 120.0:.6f}', '0', '0', '0', '1', '0.1', '0.2', '0.3']
            for i in range(30)]
    first = ('Format Version,1.23,Export Frame Rate,120.000000,Total Exported Frames,30,'
             'Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global')
    path.write_text('\n'.join([first, '', *(','.join(row) for row in head + rows)]))


KINDS = {
    'minidrone': (minidrone.main, '.mat', lambda path: simulink(path, True), mutated, []),
    'plain minidrone': (
        minidrone.main, '.mat', lambda path: simulink(path, False), mutated, []),
    'crazyflie': (import_crazyflie.main, '.json', crazyflie, reworded, ['--mocap-offset', '0']),
    'motive': (import_motive.main, '.csv', motive, reworded, [])}


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
