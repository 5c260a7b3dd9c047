"""What the verdict says of an estimator's state, at and beside each of its limits."""

from mambo_analysis.compare import verdict as judge
from mambo_analysis.compare.verdict import FAR, FAR_TIME, FASTEST, first_long_run, verdict
from mambo_estimation import health
import numpy as np
import pytest

PERIOD = 0.01  # s
COUNT = 500
START = 70 * 10**9  # ns, the clock of the bag does not begin at 0


class Messages(dict):
    """Columns of a topic, by name."""

    @property
    def stamp(self):
        return self['stamp']

    def __len__(self):
        return len(self['stamp'])

    def __getattr__(self, name):
        return self[name]


def stamps():
    return START + np.arange(COUNT) * round(PERIOD * 1e9)


@pytest.fixture
def flight():
    """Return a bag of a flight without a fault, whose columns a test may change."""
    nothing = np.full(COUNT, np.nan)
    sonar = nothing.copy()
    sonar[::5] = 0.01
    inner = Messages(
        stamp=stamps(), status=np.full(COUNT, 2), sonar_innovation=sonar,
        health=np.zeros((COUNT, len(health.NAMES)), int), height=np.ones(COUNT),
        age=np.zeros((COUNT, len(health.NAMES))), sonar_refused=np.zeros(COUNT, int),
        flow_refused=np.zeros(COUNT, int), barometer_refused=np.zeros(COUNT, int),
        sonar_test_ratio=nothing, flow_test_ratio=nothing, barometer_test_ratio=nothing,
        accel_bias=np.zeros((COUNT, 3)), gyro_bias=np.zeros((COUNT, 3)))
    return {
        'estimator/state': inner,
        'estimate/odom': Messages({'stamp': stamps(),
                                   'orientation': np.tile([0.0, 0.0, 0.0, 1.0], (COUNT, 1)),
                                   'twist.twist.linear': np.zeros((COUNT, 3))})}


def first_line(flight):
    return verdict(flight, flight).splitlines()[0]


def test_a_flight_without_a_fault_did_not_diverge(flight):
    assert first_line(flight) == 'verdict: the estimate did not diverge'


@pytest.mark.parametrize(('share', 'told'), [(0.4, False), (0.6, True), (1.0, True)])
def test_a_vehicle_that_is_upside_down_most_of_the_time_is_told(flight, share, told):
    flight['estimate/odom']['orientation'][:round(share * COUNT)] = [0.8, -0.6, 0.0, 0.0]
    assert (f'upside down in {share:.0%} of the steps' in first_line(flight)) == told


@pytest.mark.parametrize(('seconds', 'reported'), [
    (FAR_TIME - 0.1, False), (FAR_TIME + 0.1, True)])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_height_that_is_far_for_long_diverged_at_a_named_time(flight, seconds, reported, sign):
    innovation = flight['estimator/state']['sonar_innovation']
    begin = 200
    innovation[begin:begin + round(seconds / PERIOD) + 1:5] = sign * (FAR + 0.01)
    assert ('height diverged at 2.00 s: more than 0.5 m' in first_line(flight)) == reported


def test_a_height_at_the_limit_is_not_far(flight):
    flight['estimator/state']['sonar_innovation'][::5] = FAR
    assert 'did not diverge' in first_line(flight)


def test_a_range_between_that_fits_ends_the_run(flight):
    innovation = flight['estimator/state']['sonar_innovation']
    innovation[100:300:5] = 2.0
    innovation[180] = 0.0
    assert 'height diverged' in first_line(flight)  # 1.15 s are left behind it
    innovation[200:300:5] = 0.0
    assert 'did not diverge' in first_line(flight)


@pytest.mark.parametrize(('velocity', 'reported'), [
    ((0.99 * FASTEST, 0.0, 0.0), False), ((0.8 * FASTEST, 0.0, 0.8 * FASTEST), True),
    ((0.0, -1.01 * FASTEST, 0.0), True), ((np.nan, 0.0, 0.0), True)])
def test_a_speed_that_no_vehicle_has_is_a_divergence(flight, velocity, reported):
    flight['estimate/odom']['twist.twist.linear'][150:152] = velocity
    line = first_line(flight)
    assert ('velocity diverged at 1.50 s: faster than 10 m/s' in line) == reported
    assert ('did not' in line) == (not reported)


@pytest.mark.parametrize(('aligning', 'reported'), [(COUNT, True), (COUNT - 1, False), (0, False)])
def test_an_estimator_that_never_aligned_is_reported(flight, aligning, reported):
    flight['estimator/state']['status'][:aligning] = judge.ALIGNING
    assert ('never aligned: the vehicle did not rest' in first_line(flight)) == reported


def test_everything_that_is_wrong_is_in_the_first_line(flight):
    flight['estimator/state']['status'][:] = judge.ALIGNING
    flight['estimator/state']['sonar_innovation'][::5] = 1.0
    flight['estimate/odom']['twist.twist.linear'][:] = 99.0
    assert first_line(flight).count(';') == 2


def test_each_sensor_is_told_by_its_own_health(flight, monkeypatch):
    monkeypatch.setattr(judge, 'SENSORS', {
        topic: (None, lambda messages: (messages['values'],)) for topic, _ in judge.AIDING})
    inner = flight['estimator/state']
    inner['health'][:50, 0] = health.OUT_OF_REACH + 1       # a tenth of the time
    inner['health'][:100, health.SONAR] = health.OUT_OF_REACH + 1
    inner['health'][100:125, health.SONAR] = health.OUT_OF_REACH
    inner['sonar_refused'][:] = np.linspace(0, 30, COUNT).astype(int)
    values = np.ones((100, 1))
    values[60:] = np.nan  # what is no number is no sample
    flight['sonar/range'] = Messages(
        stamp=stamps()[:100], values=values, min_range=np.full(100, 0.5))
    inner['age'][:20, 1] = 0.005  # no sample that could be used
    lines = verdict(flight, flight).splitlines()[1:]
    assert lines[1].endswith('of the time, without a usable sample in 4.0% of the steps')
    assert len(lines) == health.SONAR + len(judge.AIDING)
    assert lines[0] == f'  {health.NAMES[0]}: unhealthy for 10.0% of the time'
    assert lines[health.SONAR] == (
        f'  {health.NAMES[health.SONAR]}: 60 samples, 50.0% refused; unhealthy for 20.0% of the '
        'time, out of reach for 5.0%')
    assert lines[health.SONAR + 1] == f'  {health.NAMES[health.SONAR + 1]}: absent'
    flight['range/none'] = flight['sonar/range']
    flight['sonar/range'] = Messages(
        stamp=stamps()[:100], values=np.full((100, 1), np.nan), min_range=np.zeros(100))
    assert verdict(flight, flight).splitlines()[1 + health.SONAR] == (
        f'  {health.NAMES[health.SONAR]}: none of 100 samples is valid and within its limits: '
        'check its unit, and whether the vehicle flew')
    flight['sonar/range'] = flight.pop('range/none')
    inner['sonar_refused'][-1] = 10**6  # of samples that the bag lacks: all of those it has
    assert '100.0% refused' in verdict(flight, flight)


@pytest.mark.parametrize('state', [None, 'empty'])
def test_without_the_estimators_own_state_there_is_no_verdict(flight, state):
    if state is None:
        del flight['estimator/state']
    else:
        flight['estimator/state']['stamp'] = np.empty(0, np.int64)
    assert verdict(flight, flight) == 'verdict: none, as there is no estimator/state'


@pytest.mark.parametrize(('far', 'least', 'begin'), [
    ([0, 0, 0, 0, 0], 1.0, None), ([1, 1, 1, 0, 1], 2.0, 0.0), ([1, 1, 0, 1, 1], 1.0, 0.0),
    ([1, 0, 1, 1, 1], 2.0, 2.0), ([1, 1, 1, 1, 1], 4.0, 0.0), ([1, 1, 1, 1, 1], 4.1, None),
    ([0, 0, 0, 0, 1], 0.0, 4.0), ([], 1.0, None)])
def test_the_first_run_that_is_long_enough(far, least, begin):
    found = first_long_run(np.arange(len(far)) * 1.0, np.array(far, bool), least)
    assert np.isnan(found) if begin is None else found == begin


@pytest.mark.parametrize('lost, share', [((), '5.0%'), ((30, 31, 32, 33, 34), '4.0%')])
def test_a_sonar_nearer_to_the_floor_than_its_shortest_range_is_out_of_reach(
        flight, monkeypatch, lost, share):
    """By height and tilt, but where it is unhealthy, which is a share of its own."""
    monkeypatch.setattr(judge, 'SENSORS', {
        topic: (None, lambda messages: (messages['values'],)) for topic, _ in judge.AIDING})
    inner = flight['estimator/state']
    flight['sonar/range'] = Messages(
        stamp=stamps(), values=np.ones((COUNT, 1)), min_range=np.full(COUNT, 0.5))
    inner['height'][:100] = 0.45
    inner['health'][:25, health.SONAR] = health.MISSING
    flight['estimate/odom']['orientation'][50:100] = [0.3, 0.0, 0.0, np.sqrt(0.91)]  # 0.41 m
    kept = np.setdiff1d(np.arange(COUNT), lost)  # of a recording that lacks some estimates
    flight['estimate/odom'] = Messages(
        {name: values[kept] for name, values in flight['estimate/odom'].items()})
    line = verdict(flight, flight).splitlines()[1 + health.SONAR]
    assert line.endswith(f'unhealthy for 5.0% of the time, out of reach for {share}')
