"""A command that lacks something ends well or in one line; and one that does not is noticed."""

from pathlib import Path
import random
import sys

from mambo_model import compiled
import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / 'tools'))
from chaos_files import resources, starved, tasks  # noqa: E402 (scripts of tools/, not a package)
from chaos_files.scarce import MOUNTED, SCARCITIES  # noqa: E402

QUICK = ('recover', 'import', 'digest', 'urdf')  # which compile nothing
PRIVATE = not starved.permitted()


@pytest.mark.slow
def test_a_quick_command_survives_every_scarcity(capsys):
    lost = resources.resources(len(SCARCITIES), 1, jobs=2, commands=QUICK)
    printed = capsys.readouterr().out
    assert not lost, printed
    rows = [line for line in printed.splitlines() if line.startswith(tuple(SCARCITIES))]
    assert len(rows) >= len(SCARCITIES) - len(MOUNTED) - 1
    assert f'survived {len(SCARCITIES)}, lost 0;' in printed


def test_the_same_seed_and_number_give_the_same_attempt():
    first, again, other = ([resources.chosen(number, seed) for number in range(40)]
                           for seed in (1, 1, 2))
    assert first == again != other
    assert {each.lacks for each in first} == set(SCARCITIES)
    assert resources.chosen(7, 1) == first[7]


def end_of(script, tmp_path, monkeypatch, lacks='file size', lines=0):
    """Return how a command in Python ends that should print so many lines."""
    monkeypatch.setattr(starved, 'START', (sys.executable, '-c', script))
    task = tasks.Task('run {out}')
    whole = tasks.Made({}, {'made': 3}, lines)
    return starved.Starved(task, lacks, random.Random(1), tmp_path, tmp_path, whole,
                           Path(compiled.numba.config.CACHE_DIR), PRIVATE).end()


SAY = 'import os, sys, time\nout = sys.argv[2]\n'
MAKE = f"{SAY}open(f'{{out}}/made', 'w').write('abc')\n"
SAID = 'sys.exit("run: File too large")'


@pytest.mark.parametrize('script, outcome', [
    (MAKE, 'done'), (SAY + SAID, 'failed'),
    (SAY + 'sys.stderr.write("run: File too large\\n"); sys.exit(2)', 'refused')])
def test_a_good_end_is_survived(script, outcome, tmp_path, monkeypatch):
    end = end_of(script, tmp_path, monkeypatch)
    assert (end.outcome, end.wrong) == (outcome, '')


@pytest.mark.parametrize('script, wrong', [
    (SAY, 'made has 0 of 3 bytes'), (f'{MAKE}sys.exit(3)', 'exit code 3'),
    (f'{MAKE}sys.stderr.write("run: it is late\\n")', 'exit code 0 with an error'),
    (f'{SAY}sys.exit(1)', 'exit code 1 behind 0 lines'),
    (f'{SAY}sys.exit("run: a\\nrun: b")', 'exit code 1 behind 2 lines'),
    (f'{SAY}sys.exit("File too large")', 'a line without the name of the command'),
    (f'{SAY}sys.exit("run: no")', 'for another reason: run: no'),
    (f'{SAY}sys.exit("run: an OSError")', 'OSError'), (f'{SAY}1 / 0', 'Traceback'),
    (f'{SAY}os.abort()', 'exit code -6'),
    (f"{SAY}open(f'{{out}}/.1.part', 'w'); {SAID}", '.1.part is left'),
    (f"{SAY}open(os.environ['TMPDIR'] + '/x', 'w'); {SAID}", "left in tmp: ['x']"),
    (f"{SAY}open(f'{{out}}/a.mcap', 'wb').write(b'x' * 3000); {SAID}", 'nor recoverable'),
    (f'{MAKE}os.fork() or time.sleep(60)', 'left running'),
    (f'{SAY}time.sleep(60)', 'did not end within')])
def test_any_other_end_is_lost(script, wrong, tmp_path, monkeypatch):
    monkeypatch.setattr(starved, 'LEFT', 0.3)
    monkeypatch.setattr(starved, 'BEGUN', 1000)
    monkeypatch.setattr(starved, 'WALL', 0.8 if 'did not' in wrong else 30.0)
    assert wrong in end_of(script, tmp_path, monkeypatch).wrong


def test_less_than_was_to_be_printed_is_lost(tmp_path, monkeypatch):
    end = end_of(MAKE, tmp_path, monkeypatch, lines=2)
    assert end.wrong == '0 of 2 lines printed'


@pytest.mark.skipif(not PRIVATE, reason='the kernel permits no namespaces')
def test_shared_memory_that_is_left_is_found(tmp_path, monkeypatch):
    end = end_of(f"{MAKE}open('/dev/shm/fastrtps_0', 'w')", tmp_path, monkeypatch)
    assert end.wrong == "shared memory left: ['fastrtps_0']"
