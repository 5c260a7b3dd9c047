"""Damage to files, the same at each run of a seed, and what an importer may make of it."""

import json
import re
import shutil

from mambo_analysis.importers.crazyflie import MOCAP
import numpy as np
import scipy.io

WORDS = ('NaN', 'Infinity', 'null', '[]', '{}', '""', '1e999', '1e308', '-1', 'true', '"a"',
         '[[1]]', '9' * 5000, '\0', ',', '\n', '"', '[' * 2000, '²')


def mutated(rng, content):
    """Return bytes with a part changed, doubled, taken out, put in, emptied or cut off."""
    data = bytearray(content)
    at, other, size = rng.randrange(len(data)), rng.randrange(len(data)), rng.choice((1, 8, 64))
    kind = rng.randrange(6)
    if kind == 0:
        return content[:at]
    if kind == 1:
        data[at] = rng.randrange(256)
    elif kind == 2:
        del data[at:at + size]
    elif kind == 3:
        data[at:at] = rng.randbytes(size)
    elif kind == 4:
        data[at:at + size] = bytes(len(data[at:at + size]))
    else:
        data[at:at + size] = data[other:other + size]
    return bytes(data)


def reworded(rng, content):
    """Return a text with one word or number replaced, or any mutation."""
    words = list(re.finditer(r'[-\w.]+|"[^"]*"', content.decode()))
    if rng.random() < 0.4:
        return mutated(rng, content)
    word, text = rng.choice(words), content.decode()
    return (text[:word.start()] + rng.choice(WORDS) + text[word.end():]).encode()


def check(main, arguments, out, capfd):
    """Run an importer; return whether there is a bag."""
    shutil.rmtree(out, ignore_errors=True)
    code = main([*arguments[:1], str(out), *arguments[1:]])
    error = capfd.readouterr().err
    if code == 0:
        assert not error and out.exists()
        return True
    assert code == 2 and error.count('\n') == 1 and len(error) < 1500, error
    assert not re.search(r'Error\(|Exception|Traceback', error), error
    assert not out.exists()
    return False


def block(values):
    return {'time': np.arange(len(values)) * 0.005, 'signals': {'values': values}}


def simulink(path, compressed):
    """Write a log with a signal for each scope."""
    rng, names = np.random.default_rng(1), ('a_x', 'a_y', 'a_z', 'p', 'q', 'r', 'pressure')
    scipy.io.savemat(path, {f'rt_{name}': block(
        rng.normal(size=200) - 9.8 * (name == 'a_z') + 1e5 * (name == 'pressure'))
        for name in names},
        do_compression=compressed)


def crazyflie(path):
    """Write a log of 40 samples."""
    times = [0.01 * i for i in range(40)]
    entry = {'time': times, 'data': [0.1 * i for i in range(40)]}
    names = ('w_x', 'w_y', 'w_z', 'a_z', 'r', 'n_x', 'n_y', 'm_1', 'm_2', 'm_3', 'm_4')
    path.write_text(json.dumps({
        'drone': {f'ae483log.{name}': entry for name in names},
        'mocap': {'time': times} | dict.fromkeys(MOCAP, times)}))


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
