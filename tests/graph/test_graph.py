"""The graph as its users run it: real processes, real DDS, real bags."""

from functools import lru_cache
import hashlib
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mambo_analysis.compare import estimate
from mambo_bags.reader import read_bag
from mambo_bags.recover import recover
from mambo_bags.writer import BagWriter
from mambo_bringup.domain import Domain
from mambo_bringup.flight import runner
from mambo_bringup.flight.nodes import COMPOSED, FLIGHT_NODES, RECORDER, SIMULATOR
from mambo_bringup.flight.outcome import FlightEndedError
from mambo_bringup.flight.runner import fly, fly_several
from mambo_bringup.processes import NodeProcess
from mambo_bringup.replay import replay
from mambo_bringup.run import main
from mambo_flight import closed_loop, offline_replay, recording_to_bag
from mambo_flight.scenario import from_yaml, override, scenario, to_yaml
from mambo_ros import cdr, messages, topics
import numpy as np
import pytest
from rclpy.serialization import deserialize_message

SECONDS = 9.0
STEPS = 1801
BUSY = 240.0  # s that a command may take on a loaded machine


def flight(seed=3, more=None, **choices):
    return scenario(duration=SECONDS, seed=seed, land=False,
                    overrides={'sim_node.mode': 'lockstep', **(more or {})}, **choices)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a recorded lockstep flight: take-off and the blend into the circle."""
    path = tmp_path_factory.mktemp('graph') / 'first' / 'flight'
    fly(flight(), path)
    return path


PACKAGE = {'estimator': 'toolbox', 'controller': 'toolbox', 'believed': 'toolbox'}


@pytest.fixture(scope='module')
def package_bag(tmp_path_factory):
    """Return the same flight with the support package's estimator, controller and belief."""
    path = tmp_path_factory.mktemp('graph') / 'package' / 'flight'
    fly(flight(**PACKAGE), path, composed=True)  # the same bag as of processes, in less time
    return path


def fault(sensor, kind, start, duration, **more):
    values = {'kind': kind, 'start': start, 'duration': duration, **more}
    return {f'sim_node.simulator.faults.{sensor}.{key}': value for key, value in values.items()}


FAULTS = {
    **fault('gyro', 'not_a_number', 5.0, 3.0, share=0.1),
    **fault('accel', 'infinite', 5.0, 3.0, share=0.1),
    **fault('imu', 'late', 4.0, 3.0, share=0.05, delay=0.03),
    **fault('sonar', 'late', 5.5, 1.0, delay=0.1),
    **fault('optical_flow', 'out_of_order', 5.0, 2.0, share=0.5),
    **fault('barometer', 'repeated', 2.0, 5.0)}


@pytest.fixture(scope='module')
def faulty_bag(tmp_path_factory):
    """Return the same flight with faults of every sensor at once."""
    path = tmp_path_factory.mktemp('graph') / 'faulty' / 'flight'
    fly(flight(more=FAULTS), path)
    return path


@lru_cache(maxsize=4)
def contents(bag):
    """Return a bag that does not change any more, read once for all its topics."""
    return read_bag(bag)


def payloads(bag, topic, namespace='/mambo'):
    name = topic.name if topic.name.startswith('/') else f'{namespace}/{topic.name}'
    return contents(bag)[name].raw


def digest(bag):
    return [hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(bag.glob('*.mcap'))]


def test_two_flights_with_one_seed_have_identical_bags(bag, tmp_path):
    again = tmp_path / 'under_another_name'
    fly(flight(), again)
    for topic in topics.RECORDED:
        first, second = payloads(bag, topic), payloads(again, topic)
        assert first and first == second, topic.name
    assert digest(bag) == digest(again)  # the files themselves, byte for byte


def test_nodes_composed_in_one_process_record_the_same_file(bag, tmp_path):
    composed = tmp_path / 'composed'
    fly(flight(), composed, composed=True)
    for topic in topics.RECORDED:
        assert payloads(composed, topic) == payloads(bag, topic), topic.name
    assert digest(composed) == digest(bag)


@pytest.mark.long
def test_a_recorder_outside_hears_all_that_composed_nodes_say(bag, tmp_path):
    inside, outside, file = (tmp_path / name for name in ('inside', 'outside', 'scenario.yaml'))
    names = [*(name for _, name in (*FLIGHT_NODES, RECORDER)), 'stranger']
    file.write_text(to_yaml(override(flight(), {'sim_node.wait_for': ','.join(names)})))
    recording = tmp_path / 'recorder.yaml'
    recording.write_text(f'/mambo/recorder_node: {{ros__parameters: {{bag: {inside}}}}}')
    with Domain():
        recorder = NodeProcess(*RECORDER, [
            '--ros-args', '-r', '__node:=stranger', '-p', f'bag:={outside}'])
        composed = NodeProcess(*COMPOSED, [
            '--ros-args', '--params-file', str(file), '--params-file', str(recording)])
        try:
            assert composed.wait(300.0) == 0, composed.lines
        finally:
            codes = composed.end(20.0), recorder.end(20.0)
    assert codes == (0, 0)
    for topic in topics.RECORDED:
        assert payloads(outside, topic) == payloads(inside, topic) == payloads(bag, topic)


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    """Return outcomes and bags, by namespace, of the same flight beside one of another seed."""
    folder = tmp_path_factory.mktemp('graph')
    bags = {space: folder / space[1:] for space in ('/mambo1', '/mambo2')}
    return fly_several(dict(zip(bags, (flight(), flight(seed=4)), strict=True)), bags), bags


@pytest.mark.long
def test_drones_side_by_side_fly_as_if_alone(bag, pair):
    outcomes, bags = pair
    assert [(o.bag, o.flown, o.missed) for o in outcomes] == [
        (path, SECONDS, 0) for path in bags.values()]
    alike = (topics.CLOCK, topics.REFERENCE, topics.SENSOR_TICK)
    for topic in topics.RECORDED:
        name = topic.name.strip('/')
        one, two = (contents(path)[f'{space}/{name}'].raw for space, path in bags.items())
        assert one == payloads(bag, topic), name
        assert len(two) and (two != one or topic in alike), name


@pytest.mark.long
def test_another_seed_is_another_flight(bag, pair):
    other = pair[1]['/mambo2']
    assert payloads(bag, topics.IMU) != payloads(other, topics.IMU, '/mambo2')


def test_no_message_is_lost(bag):
    for topic in topics.RECORDED:
        if topic.rate == 200.0:
            assert len(payloads(bag, topic)) == STEPS, topic.name
    counts = messages.decode_sensor_tick(payloads(bag, topics.SENSOR_TICK)[-1])[1]
    for topic, count in zip((topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER),
                            counts, strict=True):
        assert len(payloads(bag, topic)) == count, topic.name
    latency, rate = 0.010, 120.0
    assert len(payloads(bag, topics.OPTITRACK)) == int((SECONDS - latency) * rate) + 1


def test_live_replay_gives_the_recorded_estimate_to_the_bit(bag, tmp_path):
    for rate, name in ((0.0, 'fast'), (4.0, 'paced')):
        output = tmp_path / name
        replay(bag, output, rate)
        for topic in (topics.ESTIMATE, topics.ESTIMATOR_STATE):
            assert payloads(output, topic) == payloads(bag, topic), (name, topic.name)


def test_a_bag_that_lacks_some_seconds_is_replayed_without_a_fault(bag, tmp_path):
    """What its samples lack is no loss of the recorder of the replay."""
    damaged = tmp_path / 'damaged'
    shutil.copytree(bag, damaged)
    (file,) = damaged.glob('*.mcap')
    data = bytearray(file.read_bytes())
    for share in (0.45, 0.55, 0.65):  # some of them within a chunk, of a second each
        data[int(share * len(data))] ^= 0x55
    file.write_bytes(data)
    recover(damaged, tmp_path / 'rest')
    steps = len(payloads(tmp_path / 'rest', topics.IMU))
    assert 0 < steps < STEPS
    replay(tmp_path / 'rest', tmp_path / 'replay', 0.0)
    assert len(payloads(tmp_path / 'replay', topics.ESTIMATE)) == steps


@pytest.mark.parametrize('choices', [{}, PACKAGE], ids=['default', 'package'])
def test_offline_replay_gives_the_recorded_estimate_to_the_bit(bag, package_bag, choices):
    bag = package_bag if choices else bag
    found = offline_replay.estimate(read_bag(bag), flight(**choices).estimator_node.filter)
    for topic, table in estimate.messages(found).items():
        assert table.tobytes() == b''.join(payloads(bag, topic)), topic.name


@pytest.mark.parametrize(
    'choices', [
        pytest.param({}, id='default'),
        pytest.param(PACKAGE, id='package', marks=pytest.mark.long),
        pytest.param({'estimator': 'ground_truth'}, id='truth', marks=pytest.mark.long)])
def test_the_closed_loop_in_one_process_is_the_graph_to_the_bit(
        bag, package_bag, tmp_path, choices):
    if choices == PACKAGE:
        bag = package_bag
    elif choices:
        bag = tmp_path / 'flight'
        fly(flight(**choices), bag, composed=True)
    alone = closed_loop.fly(flight(**choices), inner=True)

    def states(topic):
        rows = [messages.decode_odometry(data)[1] for data in payloads(bag, topic)]
        return np.array([[*s.rho, *s.nu, *s.q, *s.omega] for s in rows])

    np.testing.assert_array_equal(alone.truth, states(topics.GROUND_TRUTH))
    np.testing.assert_array_equal(alone.estimate, states(topics.ESTIMATE))
    pwm = [messages.decode_motor_pwm(data)[1] for data in payloads(bag, topics.MOTOR_PWM)]
    np.testing.assert_array_equal(alone.pwm, pwm)
    poses = [messages.decode_pose(data) for data in payloads(bag, topics.OPTITRACK)]
    seen = ~np.isnan(alone.pose[:, 0])
    np.testing.assert_array_equal(alone.pose_t[seen], [t for t, _, _ in poses])
    np.testing.assert_array_equal(alone.pose[seen], [[*rho, *q] for _, rho, q in poses])
    # and so is its bag, the file itself byte for byte, as soon as it holds the same scenario text
    same = tmp_path / 'same'
    recorded = from_yaml(read_bag(bag, topics=()).attachments['scenario.yaml'])
    recording_to_bag.write(same, recorded, alone)
    for topic in topics.RECORDED:
        assert payloads(same, topic) == payloads(bag, topic), topic.name
    assert digest(same) == digest(bag)


@pytest.mark.long
def test_bad_samples_really_travel_and_the_bag_keeps_their_order(faulty_bag):
    def stamps(topic):
        return np.array([cdr.stamp_ns(data) for data in payloads(faulty_bag, topic)])

    late = np.diff(stamps(topics.IMU))
    assert (late < 0).sum() > 10
    assert (np.diff(stamps(topics.OPTICAL_FLOW)) < 0).sum() > 5
    assert (np.diff(stamps(topics.BAROMETER)) == 0).sum() == 350  # 5 s at 70 Hz, each twice
    tick = {cdr.stamp_ns(data): messages.decode_sensor_tick(data)[1][1]
            for data in payloads(faulty_bag, topics.SENSOR_TICK)}
    assert tick[5_595_000_000] == tick[5_495_000_000]  # what is 0.1 s late is not there yet
    assert tick[6_595_000_000] - tick[5_595_000_000] == 27  # 25, and the first two in time again


@pytest.mark.long
def test_with_bad_samples_closed_loop_and_replays_are_the_graph_to_the_bit(faulty_bag, tmp_path):
    alone = closed_loop.fly(flight(more=FAULTS))
    estimates = payloads(faulty_bag, topics.ESTIMATE)
    states = [messages.decode_odometry(data)[1] for data in estimates]
    np.testing.assert_array_equal(
        alone.estimate, [[*s.rho, *s.nu, *s.q, *s.omega] for s in states])
    assert np.isfinite(alone.estimate).all()
    inner = payloads(faulty_bag, topics.ESTIMATOR_STATE)
    found = offline_replay.estimate(read_bag(faulty_bag), flight().estimator_node.filter)
    assert estimate.messages(found)[topics.ESTIMATOR_STATE].tobytes() == b''.join(inner)
    assert estimate.messages(found)[topics.ESTIMATE].tobytes() == b''.join(estimates)
    np.testing.assert_array_equal(alone.health, found.estimator[:, 21:26])
    dropped = found.dropped[-1].tolist()
    assert dropped[1] == 25 and dropped[3] == 350 and min(dropped) > 0
    replay(faulty_bag, tmp_path / 'replay', 0.0)
    assert payloads(tmp_path / 'replay', topics.ESTIMATE) == estimates
    assert payloads(tmp_path / 'replay', topics.ESTIMATOR_STATE) == inner


def test_diagnostics_name_the_bad_sensor(faulty_bag):
    logged = {}
    for message in read_bag(faulty_bag, ['/diagnostics'])['/diagnostics'].objects():
        for status in message.status:
            if status.name == 'estimator_node':
                logged[message.header.stamp.sec] = (status.level, status.message)
    assert logged[1][1].startswith('dead reckoning') and ';' not in logged[1][1]
    assert 'sonar: ' in logged[6][1] and 'samples late, repeated or out of order' in logged[6][1]
    assert 'accelerometer: ' in logged[6][1] and 'samples not finite' in logged[6][1]
    assert 'optical flow: ' in logged[6][1] and 'barometer: ' in logged[4][1]


@pytest.mark.long
def test_cameras_that_lose_the_body_say_so_and_publish_no_pose(tmp_path):
    bag = tmp_path / 'flight'
    cameras = {'frame_loss': 0.05, 'markers.layout': 'symmetric', 'markers.occlusion': 0.5}
    flown = scenario(duration=4.0, seed=3, land=False, overrides={
        'sim_node.mode': 'lockstep',
        **{f'optitrack_node.optitrack.{name}': value for name, value in cameras.items()}})
    fly(flown, bag, composed=True)
    alone = closed_loop.fly(flown, inner=True)
    recording_to_bag.write(tmp_path / 'alone', flown, alone)
    assert payloads(tmp_path / 'alone', topics.DIAGNOSTICS) == payloads(bag, topics.DIAGNOSTICS)
    seen = ~np.isnan(alone.pose[:, 0])
    assert 100 < seen.sum() < 300  # of 479
    poses = [messages.decode_pose(data) for data in payloads(bag, topics.OPTITRACK)]
    np.testing.assert_array_equal(alone.pose_t[seen], [t for t, _, _ in poses])
    np.testing.assert_array_equal(alone.pose[seen], [[*rho, *q] for _, rho, q in poses])
    undisturbed = closed_loop.fly(scenario(duration=4.0, seed=3, land=False))
    np.testing.assert_array_equal(alone.truth, undisturbed.truth)  # nobody flies by the cameras
    reports = [status for data in payloads(bag, topics.DIAGNOSTICS)
               for status in deserialize_message(data, DiagnosticArray).status
               if status.name == 'optitrack_node']
    assert len(reports) == 5  # 0 to 4 s
    numbers = {entry.key: int(entry.value) for entry in reports[-1].values}
    assert numbers['frames'] == 481 and numbers['lost frames'] > 100
    under_way = numbers['frames'] - sum(numbers[x] for x in ('lost frames', 'dropped frames'))
    assert 0 <= under_way - len(poses) <= 2  # 10 ms of latency
    assert {status.message for status in reports} <= {'tracking', 'body lost'}
    for status in reports:
        assert (status.level == DiagnosticStatus.OK) is (status.message == 'tracking')


def test_the_bag_says_what_was_flown(bag):
    text = read_bag(bag, topics=()).attachments['scenario.yaml']
    recorded = from_yaml(text)
    assert recorded.sim_node.simulator == flight().sim_node.simulator
    assert recorded.reference_node == flight().reference_node


def processes_with(text):
    """Return the processes whose command line contains a text."""
    found = []
    for entry in Path('/proc').iterdir():
        try:
            if entry.name.isdigit() and text in (entry / 'cmdline').read_text():
                found.append(entry.name)
        except OSError:
            pass
    return found


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.run', *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def wait_until_flown(run, bag, size=700_000):
    """Wait until the bag of a flight holds a second or two; its start has 200 kB."""
    limit = time.monotonic() + BUSY
    while run.poll() is None and time.monotonic() < limit and not any(
            file.stat().st_size > size for file in bag.glob('*.mcap')):
        time.sleep(0.05)


@pytest.mark.parametrize('how', [[], ['--composed']], ids=['separate', 'composed'])
def test_ctrl_c_lands_a_closed_bag_and_leaves_no_process(tmp_path, how):
    bag = tmp_path / 'stopped'
    run = start('--duration', 600, '--mode', 'realtime', '--output', bag, '--no-report',
                '--controller', 'cascaded', *how)  # compiled by now
    wait_until_flown(run, bag)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=BUSY)
    assert run.returncode == 128 + signal.SIGINT, err
    assert 'stopped by you' in out and err.strip().splitlines()[-1] == 'run: ended by SIGINT'
    recording = read_bag(bag)
    assert len(payloads(bag, topics.IMU)) == len(payloads(bag, topics.MOTOR_PWM)) > 200
    assert recording.topics
    assert processes_with(str(bag)) == []


@pytest.mark.parametrize('how', [[], ['--no-report']], ids=['report', 'no_report'])
def test_a_flight_that_a_failsafe_ended_is_told_and_no_success(tmp_path, how):
    bag = tmp_path / 'tilted'
    run = start('--duration', 9, '--no-landing', '--output', bag, *how,
                '--set', 'controller_node.failsafe.height_std=0.001')
    out, err = run.communicate(timeout=BUSY)
    assert run.returncode == 1, out
    logged = err.strip().splitlines()[-1]
    assert re.fullmatch(r'run: controller_node at [\d.]+ s: .*estimate lost or unusable', logged)
    assert logged.removeprefix('run: ') in out
    if not how:
        assert logged.removeprefix('run: ') in (bag / 'index.html').read_text()


@pytest.mark.long
def test_a_node_ended_in_flight_is_told_on_the_table_and_the_page(tmp_path):
    bag = tmp_path / 'ended'
    run = start('--duration', 600, '--mode', 'realtime', '--output', bag)
    wait_until_flown(run, bag)
    (node,) = [pid for pid in processes_with('mambo_bringup.run')
               if Path(f'/proc/{pid}/comm').read_text() == 'estimator_node\n'
               and str(bag) in Path(f'/proc/{pid}/cmdline').read_text()]
    os.kill(int(node), signal.SIGTERM)
    out, err = run.communicate(timeout=BUSY)
    assert run.returncode == 1
    logged = err.strip().splitlines()[-1].removeprefix('run: ')
    assert re.fullmatch(r'flew [\d.]+ of 600 s: estimator_node was ended by SIGTERM', logged)
    assert logged in out and logged in (bag / 'index.html').read_text()


def test_a_killed_recorder_ends_the_flight_with_one_line(tmp_path):
    bag = tmp_path / 'killed'
    run = start('--duration', 600, '--mode', 'realtime', '--output', bag, '--no-report')
    wait_until_flown(run, bag)
    (recorder,) = [pid for pid in processes_with(str(bag))
                   if Path(f'/proc/{pid}/comm').read_text() == 'recorder_node\n']
    os.kill(int(recorder), signal.SIGKILL)
    _, err = run.communicate(timeout=BUSY)
    assert run.returncode == 1
    assert re.fullmatch(r'run: flew [\d.]+ of 600 s: recorder_node was ended by SIGKILL',
                        err.strip().splitlines()[-1])
    assert processes_with(str(bag)) == []


@pytest.mark.parametrize('arguments, complaint', [
    (['--trajectory', 'loop_the_loop'], 'loop_the_loop'),
    (['--duration', '-1'], 'duration'),
    (['--set', 'sim_node.simulator.vehicle.mass=-0.1'], 'mass'),
    (['--set', 'sim_node.simulator.vehicle.mas=0.1'], 'mass'),
    (['--set', 'nonsense'], 'node.parameter=value'),
    (['--seed', '1.5'], 'seed'),
    (['--believed', 'eagle'], 'eagle'),
    (['--drones', '0'], '--drones: 0 must be within 1 to 32'),
])
def test_careless_arguments_get_one_clear_line(capsys, arguments, complaint):
    try:
        code = main(arguments)
    except SystemExit as end:
        code = end.code
    err = capsys.readouterr().err
    assert code == 2
    assert complaint in err.strip().splitlines()[-1]
    assert 'Traceback' not in err


@pytest.mark.long
def test_an_existing_output_is_not_touched(tmp_path):
    keep = tmp_path / 'keep'
    keep.write_text('mine')
    run = start('--output', keep)
    _, err = run.communicate(timeout=BUSY)
    assert run.returncode == 2 and 'exists' in err
    assert keep.read_text() == 'mine'


@pytest.mark.parametrize('composed', [True, False])
def test_a_bag_that_another_flight_began_meanwhile_is_not_touched(tmp_path, monkeypatch, composed):
    other = tmp_path / 'flight'
    monkeypatch.setattr(runner, 'refuse_bag', lambda _: None)  # it was not there yet
    with BagWriter(other) as writer:
        writer.add_topic('/mambo/motor_pwm', 'mambo_interfaces/msg/MotorPwm')
        for k in range(5):
            writer.write('/mambo/motor_pwm', bytes(44), k * 10**9)
        file, held = next(other.glob('*.mcap')), next(other.glob('*.mcap')).stat()
        with pytest.raises(FlightEndedError, match='exists: give another name') as error:
            fly(scenario(duration=1.0, land=False), other, composed)
        assert (file.stat().st_ino, file.stat().st_size) == (held.st_ino, held.st_size)
    (outcome,) = error.value.outcomes
    assert not outcome.closed and not outcome.recorded
    assert len(read_bag(other, ['motor_pwm'])['motor_pwm']) == 5


def time_said(lines):
    """Return the newest time of flight that the simulator said, s; 0 before the first."""
    return max(map(float, re.findall(r' t = ([\d.]+) s', '\n'.join(lines))), default=0.0)


class Loss:
    """
    A flight in a domain of its own, from which one node goes.

    It is asked to end: at once in lockstep, and in real time as by one Ctrl-C, behind which a node
    takes messages as long as they come, 5 s.
    """

    def __init__(self, folder, mode, lost):
        self.bag, self.mode, self.lost, self.logged = folder / 'bag', mode, lost, []
        self.seconds, self.up = (16, 3.0) if mode == 'realtime' else (30, 8.0)
        file = folder / 'scenario.yaml'
        names = [name for _, name in (*FLIGHT_NODES, RECORDER)]
        file.write_text(to_yaml(override(scenario(duration=float(self.seconds), land=False), {
            'sim_node.mode': mode, 'sim_node.wait_for': ','.join(names)})))
        arguments = ['--ros-args', '--params-file', str(file)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv('ROS_DOMAIN_ID', '')  # a free one
            self.domain = Domain()
            self.nodes = {RECORDER[1]: NodeProcess(
                *RECORDER, ['--ros-args', '-p', f'bag:={self.bag}'])}
            for package, name in FLIGHT_NODES:
                self.nodes[name] = NodeProcess(package, name, arguments)
            self.sim = NodeProcess(*SIMULATOR, arguments, self.logged.append)

    def lose(self):
        """Wait until the vehicle is up, and end the node."""
        limit = time.monotonic() + 300.0
        while time_said(self.logged) < self.up and time.monotonic() < limit:
            time.sleep(0.01)
        self.nodes[self.lost].interrupt()
        if self.mode == 'lockstep':
            time.sleep(0.05)  # two equal signals at once would be one
            self.nodes[self.lost].interrupt()

    def end(self):
        """End what still runs; return the exit codes of the nodes."""
        codes = {name: node.end(20.0) for name, node in reversed(self.nodes.items())}
        self.sim.end(20.0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv('ROS_DOMAIN_ID', '')
            self.domain.release()
        return codes


@pytest.mark.long
@pytest.mark.parametrize('mode', ['realtime', 'lockstep'])
def test_a_node_that_is_gone_in_flight_lands_the_vehicle(tmp_path, mode):
    flights, codes = [], []
    try:
        for lost in ('reference_node', 'estimator_node'):  # side by side: they mostly wait
            folder = tmp_path / lost
            folder.mkdir()
            flights.append(Loss(folder, mode, lost))
        for flight in flights:
            flight.lose()
        ends = [flight.sim.wait(300.0) for flight in flights]
    finally:
        codes = [flight.end() for flight in flights]
    for flight, end, code in zip(flights, ends, codes, strict=True):
        assert end == 0, flight.logged  # flown to its end, in lockstep too
        assert set(code.values()) == {0}
        pwm = payloads(flight.bag, topics.MOTOR_PWM)
        answers = [messages.decode_motor_pwm(data) for data in pwm]
        assert answers[-1][1:] == ((0.0,) * 4, True)
        truth = [messages.decode_odometry(data)[1]
                 for data in payloads(flight.bag, topics.GROUND_TRUTH)]
        assert min(state.rho[2] for state in truth) < -0.3  # it was up
        assert truth[-1].rho[2] >= 0.0 and np.abs(truth[-1].nu).max() == 0.0
        if mode == 'lockstep':
            assert [t for t, _, _ in answers] == [
                5_000_000 * k for k in range(200 * flight.seconds + 1)]
