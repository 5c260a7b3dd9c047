"""A bag becomes a flight on a grid; what is no flight is refused; the mounting is found."""

import math
from pathlib import Path

from flown import bag, flight, MAP, MOUNTING
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.importers.any_table import import_table, shipped
from mambo_analysis.importers.checks import plausible
from mambo_analysis.twin import contradictions
from mambo_analysis.twin.force import fit_force
from mambo_analysis.twin.identify_flight import reading_notes
from mambo_analysis.twin.recorded import bias_doubt, GRAVITY, read_flight
import numpy as np
import pandas
import pytest

NANOBENCH = Path(__file__).parents[4] / '../shared/data/nanobench'


@pytest.mark.long
def test_air_rest_and_mounting(tmp_path):
    found = read_flight(bag(tmp_path))
    assert found.mounting == pytest.approx(MOUNTING, abs=1e-3)
    assert found.t[found.rest][-1] == pytest.approx(2.0, abs=0.15)
    assert found.t[found.air][0] == pytest.approx(4.3, abs=0.2)
    assert found.t[found.air][-1] == pytest.approx(15.6, abs=0.2)
    wanted = flight(noise=0.0, seconds=12.0)
    rows = np.arange(450, 1500)  # of a grid that begins at the second sample
    wrong = (found.turn[rows].inv() * wanted.turn[rows - 399]).magnitude()
    assert wrong.max() < 3e-3
    # the fit of a parabola smooths some of the trembling
    assert np.abs(found.velocity[rows] - wanted.velocity[rows - 399]).max() < 0.02
    assert found.voltage[found.air] == pytest.approx(3.6, abs=0.11)


@pytest.mark.long
@pytest.mark.parametrize('text, reason', [
    (MAP.replace('  motor_pwm: {pwm: [m1, m2, m3, m4]}\n', ''), 'no motor_pwm in the bag'),
    (MAP.replace(', acceleration: [ax, ay, az]', ''), 'lacks an acceleration'),
    (MAP[:MAP.index('  optitrack')] + MAP[MAP.index('  imu'):], 'no motion'),
])
def test_a_missing_signal_is_named(tmp_path, text, reason):
    with pytest.raises(IdentifyError, match=reason):
        read_flight(bag(tmp_path, text=text))


@pytest.mark.parametrize('change, reason', [
    (lambda data: data.assign(m1=0.0, m2=0.0, m3=0.0, m4=0.0), 'the motors never run'),
    (lambda data: data.iloc[:300], 'overlap for 3.0 s, 5 s'),
    (lambda data: data.assign(z=0.05), '0.0 s in the air'),
    (lambda data: data.iloc[::12], 'from the first to the last command .* all signals are known '
     'for .*: the attitude has too few samples, or gaps'),
])
def test_what_is_no_flight(tmp_path, change, reason):
    with pytest.raises(IdentifyError, match=reason):
        read_flight(bag(tmp_path, change))


@pytest.mark.long
def test_a_recording_cut_to_the_flight_is_all_flight(tmp_path):
    for place in ('whole', 'cut'):
        (tmp_path / place).mkdir()
    whole = read_flight(bag(tmp_path / 'whole'))
    cut = read_flight(bag(
        tmp_path / 'cut', lambda data: data[(data.t > whole.t[whole.air][0])
                                            & (data.t < whole.t[whole.air][-1])]))
    assert whole.has_ground and not cut.has_ground
    ends = 0.7  # s, left out once more
    assert np.ptp(cut.t[cut.air]) == pytest.approx(np.ptp(whole.t[whole.air]) - ends, abs=0.1)
    assert cut.mounting == pytest.approx(MOUNTING, abs=2e-3)
    assert 'it begins and ends in the air' in reading_notes(cut)[0] and not reading_notes(whole)


@pytest.mark.long
def test_a_signal_that_ends_in_flight_is_said_to_end_there(tmp_path):
    """The motors go on for 4 s without a position."""
    def cut(data):
        data.loc[data['t'] > 12.0, ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw']] = np.nan
        return data
    notes = reading_notes(read_flight(bag(tmp_path, cut)))
    assert sum('no message' in line for line in notes) == 1
    assert notes[0].startswith('bag: /mambo/optitrack/pose: no message from 12.000 to 15.99')


def test_a_second_flight_in_the_bag_is_said_to_be_unused(tmp_path):
    def again(data):
        short = data[(data.t < 12.0)].copy()
        short.t += data.t.iloc[-1] + 10.0
        return pandas.concat([data, short])
    found = read_flight(bag(tmp_path, again))
    assert found.t[found.air][0] == pytest.approx(4.3, abs=0.2)
    assert found.t[found.air][-1] == pytest.approx(15.6, abs=0.2)
    assert found.unused == pytest.approx(8.0, abs=0.5)
    line, = reading_notes(found)
    assert 'only the longest stretch in the air is used, 4.' in line and '8 s of others' in line


def test_running_motors_on_a_bench_are_no_flight(tmp_path):
    """The motors pull as in flight, but nothing moves."""
    def held(data):
        data = data[(data.t > 6.0) & (data.t < 14.0)].copy()
        for name in POSE:
            data[name] = data[name].iloc[0]
        return data
    with pytest.raises(IdentifyError, match='keep a second before take-off'):
        read_flight(bag(tmp_path, held))


def scaled(*columns, factor=-1.0):
    """Return what scales columns of a table."""
    def change(data):
        data[list(columns)] *= factor
        return data
    return change


def moved(columns, rows):
    """Return what delays columns of a table by some rows of 0.01 s."""
    def change(data):
        data[columns] = data[columns].shift(rows).bfill().ffill()
        return data
    return change


def reordered(data):
    """Return a table whose quaternions are w x y z."""
    return data.rename(columns={'qw': 'qx', 'qx': 'qy', 'qy': 'qz', 'qz': 'qw'})


def jumped(seconds):
    """Return what makes the clock of a table jump by so much in flight."""
    return lambda data: data.assign(t=data['t'] + seconds * (data.index >= 1400))


POSE = ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw']
ACCELEROMETER, GYRO = ('ax', 'ay', 'az'), ('p', 'q', 'r')


@pytest.mark.parametrize('change, reason', [
    (scaled(*ACCELEROMETER, factor=GRAVITY), 'was it in m/s.2 and imported as g'),
    (scaled('ay', 'az'), 'shows -9.7. m/s.2 upwards .* those of FRD'),
    (lambda data: data.assign(az=data['az'] + 2.3), 'upwards in the mean'),
    (scaled('y'), 'along y of the world .* correlation of -1.00: check axes and signs'),
    (scaled('x', 'y', factor=0.5), 'along x of the world .* check the units of position'),
    (reordered, 'rate: .* the order of the quaternion'),
    (scaled('qx', 'qy', 'qz'), 'turn differently .correlation -1.00'),
    (scaled(*GYRO, factor=np.pi / 180.0), 'roll rate: .* not in SI units'),
    (scaled(*GYRO, factor=180.0 / np.pi), 'roll rate: .* not in SI units'),
    (scaled(*GYRO, factor=2.0), 'more than 1.5 times apart: check unit and range'),
    (scaled('q', 'r'), 'pitch rate: gyro and tracked attitude turn differently'),
    (lambda data: data.assign(ay=0.02), 'accelerometer repeats 0.02 m/s.2 along y for'),
    (lambda data: data.assign(p=0.0), 'roll rate: .* an axis is dead'),
    (lambda data: data.assign(r=0.01), 'gyro repeats 0.01 rad/s along z'),
    (lambda data: data.assign(m3=data['m3'].where(data['m3'] == 0.0, 40000.0)),
     'motor 3 of motor_pwm has the command 40000 throughout'),
    (moved(POSE, 60), 'the poses are 0.6 s or more late against the gyro'),
    (jumped(600.0), 'imu/data_raw, with a gap of 600 s after 1[34].* jump of the clock'),
    (jumped(86400.0), 'lasts 86416 s, 7200 s are allowed, with a gap of 86400 s after 1[34].* '
                      'jump of the clock')])
def test_what_contradicts_itself_is_refused(tmp_path, monkeypatch, change, reason):
    monkeypatch.setattr(plausible, 'MOST', math.inf)  # a bag that no importer has checked
    with pytest.raises(IdentifyError, match=reason) as error:
        read_flight(bag(tmp_path, change, noise=0.05))
    assert '\n' not in str(error.value)


def test_an_accelerometer_in_g_of_a_bag_that_was_not_imported_is_named():
    with pytest.raises(IdentifyError, match='shows 0.994 m/s.2 upwards .* is it in g'):
        contradictions.refuse_upward(Path('bag'), 0.994, GRAVITY)
    contradictions.refuse_upward(Path('bag'), 9.7, GRAVITY)


def test_an_axis_that_rests_in_a_flight_without_noise_is_not_dead(tmp_path):
    """A simulated flight in a plane, which hovers before."""
    def hovered(data):
        hover = (data['t'] > data['t'].iloc[0] + 5.0) & (data['t'] < data['t'].iloc[0] + 6.5)
        data.loc[hover, ['ax', 'q']] = 0.0
        return data.assign(r=0.0)
    found = read_flight(bag(tmp_path, hovered, noise=0.0))
    assert not found.gyro[found.air, 2].any()


def test_the_axes_of_the_accelerometer_are_those_of_the_tracked_body():
    """Turned by 90 deg about z it fits gravity, but neither velocity nor attitude."""
    one = flight(noise=0.0)
    steep = np.deg2rad([60.0, 0.0, 0.0])
    with pytest.raises(IdentifyError, match='turned by 60 deg in roll and pitch'):
        contradictions.refuse_steep(Path('bag'), steep)
    with pytest.raises(IdentifyError, match='drag of 0.4 1/s across the velocity'):
        contradictions.refuse_swapped('bag', one.force[:, [1, 0]], one.body_velocity[:, :2])
    contradictions.refuse_swapped('bag', one.force[:, :2], one.body_velocity[:, :2])


@pytest.mark.long
@pytest.mark.parametrize('rows', [10, -8])
def test_poses_that_are_late_are_moved(tmp_path, rows):
    found = read_flight(bag(tmp_path, moved(POSE, rows), noise=0.05))
    assert found.late == pytest.approx(rows * 0.01, abs=0.011)
    (tmp_path / 'plain').mkdir()
    plain = read_flight(bag(tmp_path / 'plain', noise=0.05))
    assert plain.late == 0.0
    there = np.interp(found.t, plain.t, plain.position[:, 0])[found.air]
    assert np.abs(found.position[found.air, 0] - there).max() < 0.02  # m, of 0.1 m as stamped
    drag, same = (fit_force(one, blocks=0).shown['drag z'] for one in (found, plain))
    assert drag.value == pytest.approx(same.value, abs=same.half)
    assert 'and were moved by it' in reading_notes(found)[0] and not reading_notes(plain)


def test_what_is_no_bag(tmp_path):
    with pytest.raises(Exception, match='nothing'):
        read_flight(Path(tmp_path / 'nothing'))


def test_a_gap_in_the_motion_capture_shortens_what_is_used(tmp_path):
    """Of 12 s the longest stretch without a gap is used: the 8 s after it."""
    def lose(data):
        data.loc[700:800, ['x', 'y', 'z']] = np.nan
        return data
    found = read_flight(bag(tmp_path, lose))
    assert found.t[found.air][0] == pytest.approx(8.4, abs=0.2)
    assert np.isfinite(found.velocity[found.air]).all()


def test_somebody_who_carries_it_is_no_rest(tmp_path):
    """The second in which it is lifted does not count, though the motors are off."""
    found = read_flight(bag(tmp_path, lambda data: data.iloc[150:]))
    assert found.rest == slice(0, 0)


def test_body_velocity_is_that_of_the_world_turned_back(tmp_path):
    one = flight(noise=0.0, seconds=6.0)
    v = one.body_velocity
    assert np.allclose(np.linalg.norm(v, axis=1), np.linalg.norm(one.velocity, axis=1))
    assert np.allclose(one.turn.apply(v), one.velocity)


def own(tmp_path, estimate):
    """Return a bag with a reference, that steps and begins late, and an estimate or none."""
    text = MAP + '  onboard/reference: {position: [rx, ry, rz]}\n'
    if estimate:
        text += ('  onboard/odom:\n    position: [ex, ey, ez]\n'
                 '    quaternion: {columns: [qx, qy, qz, qw], order: xyzw}\n'
                 '    velocity: [vx, vy, vz]\n')

    def add(data):
        data[['rx', 'ry', 'rz']] = data[['x', 'y', 'z']].to_numpy()[(len(data) // 2)]
        data.loc[data.index >= 1000, 'rx'] = 5.0
        data.loc[data.index < 100, ['rx', 'ry', 'rz']] = np.nan
        for axis in 'xyz':
            data[f'e{axis}'] = data[axis] + 0.1
            data[f'v{axis}'] = np.gradient(data[axis], 0.01)
        return data
    return read_flight(bag(tmp_path, add, text=text)).onboard


def test_a_reference_is_held_until_the_next_one(tmp_path):
    known = own(tmp_path, False)
    step = int(np.argmax(known.reference[:, 0] == 5.0))
    assert step == pytest.approx(999, abs=1) and (known.reference[step:, 0] == 5.0).all()
    assert np.isnan(known.reference[:98]).all() and np.isfinite(known.reference[100:]).all()
    assert np.isnan(known.position).all() and np.isnan(known.attitude).all()


@pytest.mark.long
def test_the_estimate_of_the_drone_is_on_the_same_grid(tmp_path):
    known = own(tmp_path, True)
    found = read_flight(tmp_path / 'bag')
    rows = found.air
    assert np.abs(known.position[rows] - found.position[rows] - 0.1).max() < 2e-3
    assert np.abs(known.velocity[rows] - found.velocity[rows]).max() < 0.1
    assert np.isfinite(known.attitude[rows]).all()


def test_without_a_reference_nothing_is_known_on_board(tmp_path):
    assert read_flight(bag(tmp_path)).onboard is None


@pytest.mark.long
@pytest.mark.parametrize('bias', [-0.4, 0.0, 0.3])
def test_a_bias_along_z_is_taken_out_of_the_force(tmp_path, bias):
    def biased(data):
        data['az'] += bias
        return data
    found = read_flight(bag(tmp_path, biased))
    assert found.bias == pytest.approx(bias, abs=5e-3)
    assert found.mounting == pytest.approx(MOUNTING, abs=1e-3)
    folder = tmp_path / 'plain'
    folder.mkdir()
    plain = read_flight(bag(folder))
    assert found.force[found.air] == pytest.approx(plain.force[plain.air], abs=5e-3)


def test_a_bias_along_x_changes_that_along_z_in_second_order_only(tmp_path):
    """0.5 m/s^2 look like a sensor turned by 0.051 rad; the rest is within the doubt."""
    def biased(data):
        data['ax'] += 0.5
        return data
    found = read_flight(bag(tmp_path, biased))
    angle = np.hypot(*found.mounting[:2])
    assert bias_doubt(found.mounting) == pytest.approx(0.25 * GRAVITY * angle ** 2)
    assert abs(found.bias) < bias_doubt(found.mounting) + 5e-3 < 0.02


@pytest.mark.skipif(not NANOBENCH.exists(), reason='recordings are not beside the repo')
@pytest.mark.parametrize('column, axis, factor', [('px', 0, 1.2), ('py', 1, 0.9), ('pz', 2, 1.3)])
def test_one_axis_of_a_real_capture_in_another_scale_shows(tmp_path, column, axis, factor):
    """It is told outside of ``contradictions.SCALE``; the flight itself is inside."""
    table = pandas.read_csv(NANOBENCH / 'B2_circle_fast_rep1.csv')
    table[column] *= factor
    table.to_csv(tmp_path / 'flight.csv', index=False)
    bags = tmp_path / 'bag', tmp_path / 'own'
    for path, bag_ in zip((tmp_path / 'flight.csv', NANOBENCH / 'B2_circle_fast_rep1.csv'), bags):
        import_table(path, bag_, shipped()['nanobench'])
    changed, own = (read_flight(bag_).gain for bag_ in bags)
    for (low, high), (least, most) in zip(own, contradictions.SCALE):
        assert low <= most and high >= least
    least, most = contradictions.SCALE[axis]
    assert changed[axis, 0] > most or changed[axis, 1] < least


def test_the_usual_time_between_samples_is_that_of_the_slower_topic(tmp_path):
    assert read_flight(bag(tmp_path, seconds=6.0)).pace == pytest.approx(0.01)
