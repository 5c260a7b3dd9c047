"""The command from a bag to estimates and their errors."""

from pathlib import Path

from mambo_analysis.compare import estimate
from mambo_analysis.compare.compare import main as compare
from mambo_analysis.compare.verdict import verdict
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_flight import offline_replay
from mambo_flight.scenario import scenario, to_yaml
from mambo_model import schema
from mambo_model.motion.rigid_body import State
from mambo_ros import messages, topics
import numpy as np
import pytest

STEP = 5_000_000  # ns
HEIGHT = Path(__file__).parents[4] / 'examples/alpha_beta_filter.py'


def rest(path, **options):
    """Write half a second on the floor, with the truth; return its path."""
    with BagWriter(path, **options) as bag:
        for topic in (topics.IMU, topics.GROUND_TRUTH):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        state = State((0.0, 0.0, 0.0), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
        for t in range(0, 100 * STEP, STEP):
            bag.write(f'/mambo/{topics.IMU.name}', messages.imu(
                t, (1e-4, 0.0, 0.0), (0.0, 0.0, -9.81), (0.0,) * 3, (0.0,) * 3), t)
            bag.write(f'/mambo/{topics.GROUND_TRUTH.name}', messages.ground_truth(t, state), t)
    return path


def counted(source, gone=(), again=()):
    """Write half a second on the floor with watermarks, samples of the barometer gone or twice."""
    with BagWriter(source) as bag:
        for topic in (topics.IMU, topics.BAROMETER, topics.SENSOR_TICK):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k in range(100):
            t = k * STEP
            bag.write(f'/mambo/{topics.IMU.name}', messages.imu(
                t, (1e-4, 0.0, 0.0), (0.0, 0.0, -9.81), (0.0,) * 3, (0.0,) * 3), t)
            for _ in range((k not in gone) + (k in again)):
                bag.write(f'/mambo/{topics.BAROMETER.name}', messages.pressure(t, 1e5, 1.0), t)
            bag.write(f'/mambo/{topics.SENSOR_TICK.name}',
                      messages.sensor_tick(t, k + 1, 0, 0, k + 1), t)
    return str(source)


@pytest.mark.long
@pytest.mark.parametrize('gone, short', [((60,), False), (range(80, 100), True)])
def test_samples_that_are_not_in_the_bag_are_told_and_so_is_an_early_end(
        tmp_path, capsys, gone, short):
    assert estimate.main([counted(tmp_path / 'source', gone)]) == 0
    output = capsys.readouterr().out
    lost = len(gone)
    assert f'  barometer/pressure: {lost} of 100 samples that were published are not in' in output
    assert 'imu/data_raw: ' not in output.partition('verdict')[2]
    assert ('  the estimate ends 0.10 s before the recording' in output) is short


@pytest.mark.long
def test_repeated_samples_that_no_watermark_counts_are_told(tmp_path, capsys):
    assert estimate.main([counted(tmp_path / 'source', again=(7, 8, 50))]) == 0
    assert ('\n  barometer/pressure: 3 samples that only repeat the one before, and that no '
            'watermark counts, were left out\n') in capsys.readouterr().out + '\n'


def flown(**choices):
    return {'attachments': {'scenario.yaml': to_yaml(scenario(**choices))}}


@pytest.mark.long
@pytest.mark.parametrize(('when', 'output'), [
    ('rest.alignment.count > 40', True), ('gyro[0] > 0.0', False)])  # samples at rest: 0.2 s
def test_an_estimator_of_ones_own_that_fails_is_named_behind_what_it_gave(
        tmp_path, capsys, when, output):
    file = tmp_path / 'broken.py'
    file.write_text(HEIGHT.read_text().replace(
        'rest, height, climb, since = memory',
        'rest, height, climb, since = memory\n'
        f"    if {when}:  # not in the trial\n        raise ValueError('lost my way')", 1))
    place = f'{file}:{file.read_text()[:file.read_text().index("raise Val")].count(chr(10)) + 1}'
    (tmp_path / 'own.yaml').write_text(
        f'/mambo/estimator_node:\n  ros__parameters:\n    estimator: {HEIGHT}\n')
    words = [str(rest(tmp_path / 'bag')), '--parameters', str(tmp_path / 'own.yaml')]
    assert estimate.main(words) == 0 and 'lost my way' not in capsys.readouterr().out
    (tmp_path / 'own.yaml').write_text((tmp_path / 'own.yaml').read_text().replace(
        str(HEIGHT), str(file)))
    out = tmp_path / 'out'
    assert estimate.main([*words, '-o', str(out)]) == 1
    said = capsys.readouterr()
    told = f'verdict: the estimator failed: {place}: ValueError: lost my way'
    assert (told in said.out) == output
    assert said.err == f'estimate: {tmp_path / "bag"}: {place}: ValueError: lost my way\n'
    assert out.exists() == output


def test_it_tells_errors_and_writes_the_estimates(tmp_path, capsys):
    source, out = rest(tmp_path / 'source'), tmp_path / 'out'
    assert estimate.main([str(source), '--out', str(out)]) == 0
    output = capsys.readouterr().out
    assert 'times real time' in output
    assert 'replayed estimate/odom minus ground_truth/odom' in output
    bag, (_, (found, *_), _) = read_bag(out), estimate.again(source)
    for topic, table in estimate.messages(found).items():
        assert b''.join(bag[topic.name].raw) == table.tobytes() and len(table) == 100
    assert compare([str(out), str(source), '--a-topic', 'estimate/odom', '--b-topic',
                    'ground_truth/odom', '--no-align']) == 0


@pytest.mark.long
def test_a_simulated_flight_is_judged_by_its_optitrack(capsys):
    bag = Path(__file__).parents[4] / 'bags/circle_short'
    assert estimate.main([str(bag)]) == 0
    output = capsys.readouterr().out
    assert 'estimation error: replayed estimate/odom minus optitrack/pose' in output
    assert 'note: ' not in output  # both frames begin where the vehicle stood


def test_what_was_estimated_again_is_compared_with_what_the_bag_holds(tmp_path, capsys):
    source = rest(tmp_path / 'source')
    bag = read_bag(source)
    again = estimate.answered(bag, offline_replay.estimate(bag, estimate.parameters(bag).filter))
    bag.add(again['estimate/odom'])
    assert '100 of 100 recorded messages answered bit for bit' in estimate.compare_replay(
        bag, again)


def test_the_estimator_is_that_of_the_bag_or_of_a_file(tmp_path):
    bag = read_bag(rest(tmp_path / 'toolbox', **flown(estimator='toolbox')))
    assert estimate.parameters(bag).estimator == 'toolbox'
    file = tmp_path / 'other.yaml'
    file.write_text(to_yaml(scenario(
        overrides={'estimator_node.kalman.optical_flow.constant': 2.0})))
    other = estimate.parameters(bag, file)
    assert (other.estimator, other.kalman.optical_flow.constant) == ('joint', 2.0)
    for name, options in (('truth', flown(estimator='ground_truth')), ('plain', {})):
        bag = read_bag(rest(tmp_path / name, **options))
        assert estimate.parameters(bag) == scenario().estimator_node


@pytest.mark.long
def test_it_says_whose_parameters_were_used(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('/mambo/estimator_node: {ros__parameters: {joint: {sonar: {noise: 0.1}}}}')
    flight, plain = rest(tmp_path / 'flight', **flown(estimator='toolbox')), rest(tmp_path / 'a')
    for path, given, said in (
            (flight, None, 'estimator: toolbox, parameters of the bag'),
            (flight, file, f'estimator: joint, parameters of {file}, all others by default '
                           '(the bag was flown with estimator toolbox)'),
            (plain, file, f'estimator: joint, parameters of {file}, all others by default'),
            (plain, None, 'estimator: joint, parameters of the simulated Mambo, as the bag holds '
                          'none: --parameters FILE gives those of a vehicle')):
        assert estimate.again(path, given)[2].splitlines()[0] == said


def test_a_file_takes_the_place_of_a_scenario_that_cannot_be_read(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('estimator_node: {ros__parameters: {joint: {sonar: {noise: 0.1}}}}')
    bag = read_bag(rest(tmp_path / 'flight', **flown(estimator='toolbox')), estimate.READ)
    bag.attachments['scenario.yaml'] = 'estimator_node: {ros__parameters: {estimator: gone}}'
    with pytest.raises(schema.ParameterError):
        estimate.chosen(bag, None)
    assert estimate.chosen(bag, file)[1] == f'{file}, all others by default'


def test_parameters_of_another_drone_are_refused(tmp_path):
    plain, file = rest(tmp_path / 'a'), tmp_path / 'own.yaml'
    for name, same in (('/mambo2', False), ('/mambo', True), ('', True), ('/**', True)):
        file.write_text(f'{name}/estimator_node: {{ros__parameters: {{joint: '
                        '{sonar: {noise: 0.1}}}}'.removeprefix('/' * (not name)))
        if same:
            estimate.again(plain, file)
        else:
            with pytest.raises(schema.ParameterError, match='is of another drone than /mambo'):
                estimate.again(plain, file)


@pytest.mark.parametrize('options, text, output', [
    (['--out', 'SOURCE'], '', 'exists: give another --out'),
    (['--out', 'fl\udcfcg'], '', r'fl\xfcg cannot be the name of a bag: it is not UTF-8'),
    (['--parameters', 'nowhere.yaml'], '', 'nowhere.yaml: No such file'),
    (['--parameters', 'FILE'], to_yaml(scenario(estimator='ground_truth')), 'ground_truth'),
    (['--parameters', 'FILE'], '][', 'FILE:1: not valid YAML'),
    (['--parameters', 'FILE'], '/mambo/controller_node: {ros__parameters: {controller: indi}}',
     'FILE: holds no parameters of estimator_node'),
    (['--namespace', 'other'], '', 'nothing in the namespace /other')])
def test_careless_arguments_get_one_line(tmp_path, monkeypatch, capsys, options, text, output):
    monkeypatch.chdir(tmp_path)
    rest(tmp_path / 'SOURCE')
    (tmp_path / 'FILE').write_text(text)
    assert estimate.main(['SOURCE', *options]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith('estimate: ') and output in complaint
    assert complaint.count('\n') == 1


@pytest.mark.parametrize('text', ['][', 'a: 1', '3'])
def test_a_broken_scenario_in_a_bag_is_named(tmp_path, capsys, text):
    rest(tmp_path / 'bag', attachments={'scenario.yaml': text})
    assert estimate.main([str(tmp_path / 'bag')]) == 2
    complaint = capsys.readouterr().err
    assert 'scenario.yaml in ' in complaint and complaint.count('\n') == 1


def test_a_bag_without_sensors_gets_one_line(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/clock', topics.CLOCK.type_name)
        bag.write('/clock', messages.clock(0), 0)
    assert estimate.main([str(tmp_path / 'bag')]) == 2
    assert capsys.readouterr().err == (
        f'estimate: {tmp_path / "bag"}: no topic /imu/data_raw; it has /clock\n')


def test_the_verdict_names_what_was_absent_and_whether_it_diverged(tmp_path, capsys):
    assert estimate.main([str(rest(tmp_path / 'source'))]) == 0
    output = capsys.readouterr().out
    assert 'verdict: the estimate did not diverge' in output
    for sensor in ('sonar', 'optical flow', 'barometer'):
        assert f'  {sensor}: absent' in output


def test_the_verdict_says_when_the_height_diverged_and_what_was_refused(tmp_path):
    source = rest(tmp_path / 'source')
    bag = read_bag(source)
    found = offline_replay.estimate(bag, estimate.parameters(bag).filter)
    stretched = found._replace(t=np.arange(len(found.t)) * 50_000_000)  # 5 s
    stretched.estimator[40:80, 10] = 2.0  # m, innovation of the sonar, from 2 to 3.95 s
    stretched.state[60:, 3] = 50.0  # m/s
    text = verdict(bag, estimate.answered(bag, stretched))
    assert 'height diverged at 2.00 s: more than 0.5 m from the sonar' in text
    assert 'velocity diverged at 3.00 s: faster than 10 m/s' in text
    stretched.estimator[45:80:10, 10] = 0.1  # a range that fits each 0.5 s
    assert 'height' not in verdict(bag, estimate.answered(bag, stretched))


def test_without_the_estimators_own_state_there_is_no_verdict(tmp_path):
    bag = read_bag(rest(tmp_path / 'source'))
    assert verdict(bag, bag) == 'verdict: none, as there is no estimator/state'


def test_samples_from_before_time_zero_are_refused_as_the_nodes_do(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(f'/mambo/{topics.IMU.name}', topics.IMU.type_name)
        for k in range(100):
            bag.write(f'/mambo/{topics.IMU.name}', messages.imu(
                (k - 40) * STEP, (0.0,) * 3, (0.0, 0.0, -9.81), (0.0,) * 3, (0.0,) * 3), k * STEP)
    assert estimate.main([str(tmp_path / 'bag')]) == 2
    assert capsys.readouterr().err == (
        f'estimate: {tmp_path / "bag"}: /mambo/imu/data_raw: 40 of 100 stamps are below 0, the '
        'first is -0.200 s: no node takes them\n')
