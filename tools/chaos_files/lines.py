"""Command lines of every command with options and values of all kinds."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
import random

from mambo_bringup import mambo

LONG = ('run', 'replay', 'view', 'check-node', 'reproduce', 'drift', 'recordings', 'consistency',
        'estimators', 'race', 'coverage', 'identify coverage', 'identify drag')
"""Commands that start processes or fly for minutes: only command lines that are refused."""
VALUES = ('', '-', '--', 'nan', 'inf', '-1', '0', '1', '2.5', '1e400', '9' * 5000, 'x' * 300,
          'x' * 5000, 'a\0b', '\N{GRINNING FACE}', '\udcff', '../..', '/', '/dev/null',
          '/dev/full', '/proc/self/mem', '/proc/none/new', '{good}', '{file}', '{folder}',
          '{fifo}', 'none.py', 'hover', 'fig_5_11', '-o', '[1, 2', '{a: b}', 'a=b',
          'sim_node.duration=0.1', '\x1b[2J', '%s', '~', '*', 'true', 'a,b', '/a:=b')
REFUSED = ('--no-such-option', '--json=/proc/none/new', '--output=/dev/null/a')
OUTPUTS = ('{out}', '{out}/a/b', '/proc/none/new', '/dev/full', '/dev/null/a', '{file}', '{good}',
           '', 'x' * 300, '{folder}', '-')


def line(rng: random.Random, places: dict[str, str]) -> list[str]:
    """Return a command line, without ``mambo``; places are those of the templates."""
    names = [name for name, entry in mambo.COMMANDS.items() if not mambo.is_script(entry)]
    name = rng.choice(names)
    parser = import_module(mambo.COMMANDS[name].module).parser()
    words: list[str] = []
    for action in parser._actions:
        if action.option_strings:
            if isinstance(action, argparse._HelpAction) or rng.random() > 0.15:
                continue
            words.append(rng.choice(action.option_strings))
        elif rng.random() < 0.1:
            continue
        count = {0: 0, None: 1, '?': rng.randint(0, 1), '*': rng.randint(0, 3),
                 '+': rng.randint(1, 3)}.get(action.nargs, 1)
        words += [_value(rng, action) for _ in range(count)]
    if name in LONG:  # refused at once: nothing is flown
        words.append(rng.choice(REFUSED))
    elif name == 'fly':
        words += ['--duration', '0.05']
    elif name == 'bound':
        words += ['--seeds', '0'] if rng.random() < 0.9 else []
    if rng.random() < 0.2:
        rng.shuffle(words)
    for key, value in places.items():
        words = [word.replace(f'{{{key}}}', value) for word in words]
    return [*name.split(), *words]


def _value(rng: random.Random, action: argparse.Action) -> str:
    """Return a value for an argument, half of the time one that it may take."""
    if action.choices and rng.random() < 0.5:
        return str(rng.choice(list(action.choices)))
    if action.dest in ('output', 'json', 'html', 'csv', 'figure', 'write', 'last'):
        return rng.choice(OUTPUTS)
    if action.type is Path and rng.random() < 0.5:
        return rng.choice(('{good}', '{file}', '{folder}', '{fifo}'))
    return rng.choice(VALUES)
