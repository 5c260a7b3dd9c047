"""A good file of every format that a command reads, its damage, and the commands that read it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
import json
from pathlib import Path
import random
import re
import shutil
import sqlite3
from typing import NamedTuple

import damage
import fuzzing
from mambo_bags import mcap_reader
from mambo_flight import scenario, scenario_file
from mambo_model.vehicle import parameters
import numpy as np
import pandas
from synthetic import make_flight

from . import ROOT

BAG = (
    'compare {file}', 'compare {file} {good}', 'compare {file} --html {out}.html',
    'recover {file} {out}', 'import bag {file} {out}', 'identify flow {file}',
    'identify sensors {file}', 'join {file} {good} {out}', 'join {good} {file} {out}',
    'identify inertia {file} --separation 0.1 --length 1 --mass 0.06')
FILTERED = ('estimate {file} -o {out}', 'identify motor {file}', 'identify flight {file}',
            'identify drift {file}', 'twin {file} {good}', 'bound {file}')
SCENARIO = ('fly {file} --print-scenario',)
VEHICLE = ('fly --trajectory hover --vehicle {file} --print-scenario',)
FLIGHT = ('fly {file} --set sim_node.duration=0.05 -o {out}',)
DRONE = ('trajectory check {examples}/figure_eight.csv --vehicle {file}',
         'fly --trajectory hover --vehicle {file} --duration 0.05 --no-landing -o {out}')
COURSE = ('trajectory check {file}', 'trajectory check {file} --stretch auto',
          'trajectory plan {file} -o {out}.csv')
TABLE = ('import table {file} {out} --map {map}',)
MAP = """\
time: {column: t, unit: s}
world: z_up
body: flu
topics:
  optitrack/pose:
    position: {columns: [x, y, z], unit: cm}
    quaternion: {columns: [qw, qx, qy, qz], order: wxyz}
  imu/data_raw:
    angular_velocity: {columns: [x, y, z], unit: deg/s}
    acceleration: {columns: [x, y, z], unit: g}
"""
Damage = Callable[[random.Random, Path, Path], None]


class Kind(NamedTuple):
    """A format: good files, how one is damaged (random, good file, damaged file), commands."""

    files: list[Path]
    damage: Damage
    commands: tuple[str, ...]


def of_bytes(rng: random.Random, good: Path, file: Path) -> None:
    """Damage a file as bytes."""
    file.write_bytes(fuzzing.spoilt(rng, good.read_bytes()))


def of_text(rng: random.Random, good: Path, file: Path) -> None:
    """Damage a text by its lines, its words or its bytes."""
    data, kind = good.read_bytes(), rng.randrange(3)
    if kind == 0:
        file.write_text(fuzzing.spoilt_text(rng, data.decode()), errors='replace')
    elif kind == 1:
        file.write_bytes(damage.reworded(rng, data))
    else:
        file.write_bytes(_renumbered(rng, data))


def _renumbered(rng: random.Random, data: bytes) -> bytes:
    """Return a text of which some numbers are extreme ones."""
    text = data.decode()
    for _ in range(rng.randint(1, 3)):
        found = list(re.finditer(r'-?\d+\.?\d*(?:e-?\d+)?', text))
        if found:
            number = rng.choice(found)
            value = rng.choice(('nan', 'inf', '-inf', '0', '-1', '1e9', '1e-9', '1e308', '-1e308',
                                '1e-320', '9' * 400, str(2 ** 63), '0.1', '1e15'))
            text = text[:number.start()] + value + text[number.end():]
    return text.encode()


def of_bag(rng: random.Random, good: Path, file: Path) -> None:
    """Damage a bag in its bytes, records, chunks, schemas or messages."""
    fuzzing.damage_bag(rng, good, file)


def of_metadata(rng: random.Random, good: Path, file: Path) -> None:
    """Put a damaged metadata.yaml beside the whole file of a bag."""
    file.mkdir()
    shutil.copy(good.with_name('flight_0.mcap'), file)
    of_text(rng, good, file / 'metadata.yaml')


def of_mat(rng: random.Random, good: Path, file: Path) -> None:
    """Damage a MATLAB file by its elements, or as bytes."""
    fuzzing.damage_mat(rng, [good.read_bytes()], file)


def of_database(rng: random.Random, good: Path, file: Path) -> None:
    """Damage a database as bytes, or its rows by values of any type."""
    if rng.random() < 0.4:
        of_bytes(rng, good, file)
        return
    shutil.copy(good, file)
    with closing(sqlite3.connect(file)) as db, db:
        for _ in range(rng.randint(1, 3)):
            table, columns = rng.choice((
                ('topics', ('id', 'name', 'type', 'serialization_format')),
                ('messages', ('id', 'topic_id', 'timestamp', 'data'))))
            value = rng.choice((None, -1, 2 ** 62, 'text', b'', b'\0' * 8, rng.randbytes(60), '',
                                'no/msg/Such', 1e300, '9' * 5000))
            where = rng.choice(('1', f'id = {rng.randint(1, 9)}', 'id % 7 = 3'))
            try:
                db.execute(f'UPDATE OR REPLACE {table} SET {rng.choice(columns)} = ? '
                           f'WHERE {where}', (value,))
            except sqlite3.Error:
                db.execute(f'DELETE FROM {table} WHERE {where}')


def _database(path: Path, bag: Path) -> Path:
    """Write the messages of a bag into a database as rosbag2's sqlite3 storage does."""
    contents = mcap_reader.scan(bag)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
                   'serialization_format TEXT, offered_qos_profiles TEXT)')
        db.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
                   'timestamp INTEGER, data BLOB)')
        for number, channel in contents.channels.items():
            kind = contents.schemas[channel.schema_id].name
            db.execute('INSERT INTO topics VALUES(?, ?, ?, "cdr", "")',
                       (number, channel.topic, kind))
            db.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)', [
                (number, time, payload) for batch in contents.messages[number]
                for time, _, payload in list(batch)[:40]])
    return path


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def _tables(folder: Path) -> tuple[Path, Path, Path]:
    """Write a table as CSV and Parquet, and its mapping."""
    t = np.arange(60) / 100.0
    frame = pandas.DataFrame({'t': t, 'x': t, 'y': 1.0 + t, 'z': 0.5 * t, 'qw': 1.0 + 0.0 * t,
                              'qx': 0.0 * t, 'qy': 0.0 * t, 'qz': 0.0 * t, 'name': 'a'})
    frame.to_csv(folder / 'table.csv', index=False)
    frame.to_parquet(folder / 'table.parquet')
    return folder / 'table.csv', folder / 'table.parquet', _written(folder / 'map.yaml', MAP)


def _bench(folder: Path) -> list[Path]:
    """Write readings of a thrust bench as CSV and JSON."""
    pwm = np.linspace(40.0, 400.0, 30)
    rows = {'pwm': pwm.tolist(), 'thrust': (4.3e-5 * pwm ** 1.47 * (
        1.0 + 0.01 * np.sin(pwm))).tolist()}
    pandas.DataFrame(rows).to_csv(folder / 'bench.csv', index=False)
    return [folder / 'bench.csv', _written(folder / 'bench.json', json.dumps(rows))]


def _logs(folder: Path) -> dict[str, Kind]:
    """Return the formats of logs from elsewhere."""
    damage.crazyflie(folder / 'crazyflie.json')
    damage.motive(folder / 'motive.csv')
    for name, packed in (('packed', True), ('plain', False)):
        damage.simulink(folder / f'{name}.mat', packed)
    fuzzing.base_mat(folder)
    bench = sorted(folder.glob('[0-9].mat'))
    logs = [folder / 'packed.mat', folder / 'plain.mat']
    return {
        'crazyflie': Kind([folder / 'crazyflie.json'], of_text, (
            'import crazyflie {file} {out} --mocap-offset 0', 'import crazyflie {file} {out}')),
        'motive': Kind([folder / 'motive.csv'], of_text, ('import motive {file} {out}',)),
        'mat': Kind([*bench, *logs], of_mat, (
            'identify thrust {file}', 'import minidrone {file} {out}')),
        'bench': Kind(_bench(folder), of_text, ('identify thrust {file}',))}


def kinds(folder: Path) -> dict[str, Kind]:
    """Return every format by name, with its good files in a folder."""
    make_flight(folder / 'flight', 2.0)
    bag = folder / 'flight/flight_0.mcap'
    csv, parquet, mapping = _tables(folder)
    scenarios = [scenario_file.find(name) for name in ('fig_5_11', 'motion_capture')] + [
        _written(folder / 'scenario.yaml', scenario.commented_yaml(scenario.scenario()))]
    vehicles = [parameters.FOLDER / f'{name}.yaml' for name in ('identified', 'crazyflie')]
    return {
        'bag': Kind([bag], of_bag, BAG),
        'filtered': Kind([bag], of_bag, FILTERED),
        'metadata': Kind([bag.with_name('metadata.yaml')], of_metadata, BAG[:5]),
        'db3': Kind([_database(folder / 'flight.db3', bag)], of_database, (
            'import bag {file} {out}', 'import bag {file} {out} --time log')),
        'scenario': Kind(scenarios, of_text, SCENARIO),
        'flight': Kind(scenarios, of_text, FLIGHT),
        'vehicle': Kind(vehicles, of_text, VEHICLE),
        'drone': Kind(vehicles, of_text, DRONE),
        'sweep': Kind([ROOT / 'examples/yours_sweep.yaml', _written(
            folder / 'plain_sweep.yaml', 'title: Two seeds\nvary:\n  seed: [1, 2]\n')],
            of_text, ('sweep {file} --measure',)),
        'course': Kind([ROOT / 'examples/gate.yaml', ROOT / 'examples/figure_eight.csv', _written(
            folder / 'polynomials.csv', POLYNOMIALS)], of_text, COURSE),
        'table': Kind([csv], of_text, TABLE),
        'parquet': Kind([parquet], of_bytes, TABLE),
        'map': Kind([mapping], of_text, ('import table {table} {out} --map {file}',)),
        **_logs(folder)}


POLYNOMIALS = 'duration,' + ','.join(
    f'{axis}^{power}' for axis in ('x', 'y', 'z', 'yaw') for power in range(8)) + '\n' + ''.join(
    f'{duration},' + ','.join(['0.1', *'0' * 7] * 4) + '\n' for duration in (1.0, 2.0))
