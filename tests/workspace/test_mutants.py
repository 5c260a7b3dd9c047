"""The lists of mutants fit the files they break; ./mutants runs them, no test does."""

import ast
import builtins
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import called  # noqa: E402 (scripts of tools/, not a package)
import mutants  # noqa: E402

TARGETS = mutants.load()


def meaning(source):
    """Return what a source does, docstrings and comments aside, and the names it looks up."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        documented = isinstance(node, ast.ClassDef | ast.FunctionDef | ast.Module)
        if documented and ast.get_docstring(node):
            node.body[0] = ast.Pass()
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return ast.dump(tree), names


@pytest.mark.parametrize('target', TARGETS, ids=lambda target: target.name)
def test_a_file_has_ten_or_more_different_mutants_and_tests_to_kill_them(target):
    source = target.source.read_text()
    broken = {mutants.mutated(source, mutant, target.name) for mutant in target.mutants}
    assert len(broken) == len({mutant.what for mutant in target.mutants}) >= 10
    assert len(broken) == len(target.mutants)
    for test in mutants.tests_of(target, target.tests + target.without):
        file, _, name = test.partition('::')
        assert f'def {name}' in (ROOT / file).read_text()


@pytest.mark.parametrize('target', TARGETS, ids=lambda target: target.name)
def test_a_mutant_still_is_a_program_that_does_something_else(target):
    source = target.source.read_text()
    before, known = meaning(source)
    for mutant in target.mutants:
        after, names = meaning(mutants.mutated(source, mutant, target.name))
        assert after != before, mutant.what
        assert names <= known | set(dir(builtins)), mutant.what  # else any test would notice


def test_every_file_with_an_equation_has_mutants():
    rest = {  # no equation, or the vehicle's data, or (arithmetic) held to 1 ulp everywhere
        'double_double', 'exponential', 'normal', 'trigonometry',
        '__init__', 'bitcode', 'checked_file', 'compiled', 'components', 'constants', 'errors',
        'flight_command', 'height_check', 'limits', 'own_file', 'palette', 'parameter_change',
        'parameters', 'references', 'schema', 'script', 'slots', 'twins', 'uav_trajectories',
        'values', 'vector', 'vehicle_file', 'vehicle_options', 'whole_file', 'yaml_nodes'}
    model = {path.stem for path in (ROOT / 'src/mambo_model/mambo_model').rglob('*.py')}
    assert {Path(target.path).stem for target in TARGETS
            if target.package == 'mambo_model'} == model - rest


def test_the_report_is_that_of_the_lists():
    text = mutants.REPORT.read_text()
    head, *parts = text.split('\n## ')
    assert [part.split(':')[0] for part in parts] == [target.name for target in TARGETS]
    for target, part in zip(TARGETS, parts):
        for mutant in target.mutants:
            assert f'| {mutant.what} |' in part, target.name
    assert 'survived' not in ''.join(parts)


def test_a_list_that_no_longer_fits_is_refused_by_name():
    mutant = mutants.Mutant('sign', 'a - b', 'a + b')
    assert mutants.mutated('c = a - b', mutant, 'x.py') == 'c = a + b'
    for source, times in (('c = a', 0), ('c = a - b\nd = a - b', 2)):
        message = f'x.py: sign: "a - b" is there {times} times'
        with pytest.raises(mutants.MutantError, match=message):
            mutants.mutated(source, mutant, 'x.py')


@pytest.fixture(scope='module')
def dead():
    return called.uncalled(*called.read())


@pytest.mark.long
@pytest.mark.parametrize('target', TARGETS, ids=lambda target: target.name)
def test_a_program_of_the_product_calls_what_a_mutant_breaks(target, dead):
    mutants.refuse_dead(target, target.source.read_text(), dead)


def test_a_list_that_no_longer_fits_is_refused_before_anything_runs(dead):
    target, = mutants.choose(TARGETS, ['frames'])
    with pytest.raises(mutants.MutantError, match='is there 0 times, not once'):
        mutants.refuse_dead(target, '', dead)


def test_a_mutant_of_a_function_that_nothing_calls_is_refused(dead):
    target, = mutants.choose(TARGETS, ['frames'])
    source = target.source.read_text()
    line = source[:source.index(target.mutants[0].old)].count('\n') + 1
    gone = called.Definition(target.source, 'flip_vector', line - 2, line, frozenset())
    with pytest.raises(mutants.MutantError, match='y kept: no program calls flip_vector'):
        mutants.refuse_dead(target, source, [*dead, gone])


def test_every_function_is_called_but_those_that_are_offered(dead):
    """What users and tests of recordings call by name, and no program does."""
    # decode_connect: the request of a client, which the server answers without its content;
    # unserialize_library: called by numba
    assert {definition.name for definition in dead} == {
        '_ipython_key_completions_', 'decode_connect', 'find_flight', 'flight_by_acceleration',
        'flight_by_thrust', 'reference_at', 'unserialize_library'}


def test_calls_are_followed_through_functions_classes_and_tables(tmp_path):
    folder = tmp_path / 'src/mambo_x/mambo_x'
    folder.mkdir(parents=True)
    (tmp_path / 'src/mambo_x/setup.py').write_text("scripts = ['run = mambo_x.a:main']\n")
    (folder / 'a.py').write_text(
        'from b import alone\n\n'  # an import is no call
        'def main():\n    return TABLE, Thing()\n\n'
        'def alone():\n    return alone2()\n\n'
        'def alone2():\n    return alone()\n\n'  # that call each other
        'def listed():\n    return 1\n\n'
        'class Thing:\n    def __init__(self):\n        self.used()\n'
        '    def used(self): pass\n    def unused(self): pass\n\n'
        'class Based(Other):\n    def called_by_other(self): pass\n\n'
        'TABLE = [listed, Based]\n')
    dead = called.uncalled(*called.read(tmp_path))
    assert {definition.name for definition in dead} == {'alone', 'alone2', 'unused'}


def test_files_are_chosen_by_any_end_of_their_name():
    def chosen(*names):
        return [target.name for target in mutants.choose(TARGETS, list(names))]

    mixer = 'mambo_model/vehicle/motor_mixer.py'
    assert chosen('motor_mixer') == chosen(mixer) == [mixer]
    assert len(chosen('support_package')) == 2
    assert all(name.startswith('mambo_sim/') for name in chosen('mambo_sim', 'sensors/imu'))
    assert len(chosen()) == len(TARGETS)
    with pytest.raises(mutants.MutantError, match='motor: no such file'):
        chosen('motor')


@pytest.fixture
def frames(monkeypatch, tmp_path):
    """Return the command for frames.py: which mutants survive is given, nothing runs."""
    target, = mutants.choose(TARGETS, ['frames'])
    clean = target.source.read_text()

    def command(survivors, *arguments):
        alive = {mutants.mutated(clean, one, '') for one in target.mutants[:survivors]} | {clean}
        monkeypatch.setattr(mutants, 'try_source', lambda target, source, limit: mutants.Outcome(
            '' if source in alive else 'frames: test_x[a|b]', 0.5))
        monkeypatch.setattr(sys, 'argv', ['mutants', 'frames', *arguments])
        return mutants.main()

    for name in ('NUMBA_DISABLE_JIT', 'OPENBLAS_NUM_THREADS'):
        monkeypatch.setenv(name, '')  # so that it is as it was afterwards
    monkeypatch.setattr(mutants.os, 'nice', lambda more: None)
    monkeypatch.setattr(mutants, 'REPORT', tmp_path / 'mutants.md')
    return command


@pytest.mark.long
def test_a_survivor_is_named_and_makes_the_command_fail(frames, capsys):
    assert frames(0) == 0
    assert '10 of 10 killed, 0 survived' in capsys.readouterr().out
    assert frames(1) == 1
    shown = capsys.readouterr().out
    assert 'vectors: y kept: SURVIVED' in shown and '9 of 10 killed, 1 survived' in shown


@pytest.mark.long
def test_the_report_keeps_the_tables_of_other_files(frames):
    other = '## mambo_model/vehicle/motor_mixer.py: 10 of 10\n\n| error | killed by |\n|---|---|\n'
    mutants.REPORT.write_text('Of old.\n\n' + other)
    assert frames(1, '--write') == 1
    text = mutants.REPORT.read_text()
    assert text.startswith(mutants.HEAD) and other in text
    assert '## mambo_model/frames.py: 9 of 10\n' in text
    assert '| vectors: y kept | **survived** |\n' in text
    assert '| vectors: z kept | frames: test_x[a\\|b] |\n' in text
    frames(0, '--write')
    assert 'survived' not in mutants.REPORT.read_text().removeprefix(mutants.HEAD)
    assert mutants.REPORT.read_text().count('frames.py') == 1
