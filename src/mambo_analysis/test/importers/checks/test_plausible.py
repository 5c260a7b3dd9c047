"""Numbers of a small drone pass in their units, and no others."""

from mambo_analysis.importers.checks import plausible
from mambo_analysis.importers.checks.plausible import tilt_of
from mambo_bags.reader import BagError
import numpy as np
import pytest

STEP = 0.005
T = np.arange(0.0, 20.0, STEP)
RATES = np.column_stack([0.4 * np.cos(4.0 * T), 0.8 * np.sin(3.0 * T), 0.1 * T])


def test_the_integral_of_a_gyro_has_the_size_of_its_unit():
    t = np.arange(0.0, 20.0, STEP)
    tilt = np.column_stack([0.05 * np.sin(4.0 * t), 0.02 * t])  # rad; the second is a bias
    rates = np.gradient(tilt, STEP, axis=0) + 3.0
    assert tilt_of(t, rates) == pytest.approx(0.05 / 2.0, rel=0.15)
    assert tilt_of(t, np.degrees(rates)) == pytest.approx(57.3 * tilt_of(t, rates), rel=1e-3)


def test_the_tilt_of_a_gyro_with_a_gap_of_years_takes_no_time():
    late = np.where(T < 10.0, T, T + 1e9)
    calm = np.where((T < 10.0)[:, None], 0.0, RATES[:, :2])
    # the rates at the gap are 0: it adds a constant alone
    calm[(T > 9.9) & (T < 10.1)] = 0.0
    assert tilt_of(late, calm) == pytest.approx(tilt_of(T, calm), rel=0.2)


def test_a_gyro_in_degrees_is_refused_and_flips_in_radians_are_not():
    plausible.refuse_degrees('log: gyro', T, RATES)
    flips = np.where((T % 5.0 < 0.5)[:, None], [4.0 * np.pi, 0.0, 0.0], RATES)
    plausible.refuse_degrees('log: gyro', T, flips)
    crash = RATES.copy()
    crash[100] = 60.0
    plausible.refuse_degrees('log: gyro', T, crash)
    plausible.refuse_degrees('log: gyro', T[:2], np.degrees(RATES[:2]))
    with pytest.raises(BagError, match='^log: gyro: the gyro turns by up to 114.6 rad/s.*deg/s'):
        plausible.refuse_degrees('log: gyro', T, np.degrees(RATES))


def test_an_acceleration_in_g_is_refused_and_one_of_a_drone_on_its_side_is_not():
    noise = 0.05 * np.sin(T)
    plausible.refuse_g('log: a_z', 9.81 * (1.0 + noise))
    plausible.refuse_g('log: a_z', np.empty(0))
    plausible.refuse_g('log: a_z', np.where(T < 1.0, 9.81, 1.0))  # for the rest of the time
    with pytest.raises(BagError, match='^log: a_z: .* not 9.8 m/s.2: is it in g?'):
        plausible.refuse_g('log: a_z', 1.0 + noise)
    for unit in (9.81, -9.81, 100.0, 1000.0):  # g twice, of the other sign, cm/s^2, mm/s^2
        with pytest.raises(BagError, match='^log: a_z: .* not 9.8 m/s.2: give it in m/s.2$'):
            plausible.refuse_g('log: a_z', unit * 9.81 * (1.0 + noise))


def test_ranges_in_millimetres_are_refused_and_the_largest_of_16_bits_are_not():
    plausible.refuse_ranges('log: r', np.where(T < 15.0, 32.767, 0.5))
    plausible.refuse_ranges('log: r', np.where(T < 0.1, 5e4, 0.5))
    plausible.refuse_ranges('log: r', np.empty(0))
    with pytest.raises(BagError, match='^log: r: 3000 of 4000 ranges .* up to 500 m: are they in'):
        plausible.refuse_ranges('log: r', np.where(T < 15.0, 500.0, 20.0))


@pytest.mark.parametrize('step', [1.001, 0.01, 1.0 / 32000.0])
def test_every_pace_of_a_sensor_passes(step):
    plausible.refuse_pace('log: t', step * np.arange(50))
    plausible.refuse_pace('log: t', step * np.append(np.arange(50), 1e6))  # one gap


@pytest.mark.parametrize('step', [10.0, 1.6, 1e-5])
def test_a_pace_that_no_sensor_has_is_refused(step):
    with pytest.raises(BagError, match=f'^log: t: its samples are {step:.3g} s apart'):
        plausible.refuse_pace('log: t', step * np.arange(50))
    plausible.refuse_pace('log: t', step * np.arange(2))  # too few to tell


def test_stamps_in_bursts_have_the_pace_of_their_mean():
    plausible.refuse_pace('log: t', np.repeat(0.05 * np.arange(20), 5) + np.tile(
        1e-5 * np.arange(5), 20))


def test_a_hall_is_not_ten_kilometres_wide():
    position = np.zeros((9, 3))
    plausible.refuse_far('log: p', position[:0])
    position[4, 1] = -9e3
    plausible.refuse_far('log: p', position)
    position[4, 1] = -1.1e4
    with pytest.raises(BagError, match='^log: p: a position is 1.1e[+]04 m from the origin'):
        plausible.refuse_far('log: p', position)


def test_a_middle_angle_beyond_a_quarter_turn_is_found():
    assert plausible.beyond_quarter(np.array([0.0, 0.5 * np.pi, -1.58])) is None
    assert plausible.beyond_quarter(np.array([0.0, -1.6, 90.0])) == 1


def test_pressures_of_the_air_pass_in_pascal_alone():
    air = 1.013e5 + 30.0 * np.sin(T)
    plausible.refuse_pressure('log: p', np.empty(0))
    plausible.refuse_pressure('log: p', np.where(T < 5.0, 0.0, air))  # nothing measured at first
    plausible.refuse_pressure('log: p', 0.35 * air)
    for factor, usual in ((0.01, '1013'), (0.001, '101.3'), (10.0, '1.013e.06')):
        with pytest.raises(BagError, match=f'^log: p: .* a median of {usual}, .* in Pa$'):
            plausible.refuse_pressure('log: p', factor * air)


def test_few_pitches_beyond_a_quarter_turn_are_told_and_many_refused():
    pitch = 0.3 * np.sin(T)
    assert not plausible.refuse_steep('log: theta', T, pitch).any()
    pitch[:40] = -1.6
    assert np.flatnonzero(plausible.refuse_steep('log: theta', T, pitch)).tolist() == list(
        range(40))
    assert not plausible.refuse_steep('log: phi', T, 2.0 * pitch, plausible.HALF)[40:].any()
    assert not plausible.refuse_steep('log: phi', T, 1.9 * pitch, plausible.HALF).any()
    pitch[40] = -1.6
    with pytest.raises(BagError, match='^log: theta is -1.6 at 0.000 s, and 41 of 4000 values'):
        plausible.refuse_steep('log: theta', T, pitch)


def test_ranges_that_are_mostly_negative_are_refused_and_placeholders_are_not():
    plausible.refuse_ranges('log: r', np.where(T < 9.0, -1.0, 0.5))
    with pytest.raises(BagError, match='^log: r: 2200 of 4000 ranges are negative, down to -1 m'):
        plausible.refuse_ranges('log: r', np.where(T < 11.0, -1.0, 0.5))


def test_a_battery_in_millivolts_is_refused():
    plausible.refuse_voltage('log: v', np.empty(0))
    plausible.refuse_voltage('log: v', np.where(T < 5.0, 0.0, 50.0))
    for usual in (3700.0, -3.7):
        with pytest.raises(BagError, match=f'^log: v: the battery has a median of {usual:g} V'):
            plausible.refuse_voltage('log: v', np.full(9, usual))


def test_motor_commands_are_those_of_motors_that_push():
    pwm = np.tile([0.0, 0.5, 500.0, 65535.0], (100, 1))
    pwm[:4, 0] = -1.0
    plausible.refuse_commands('log: m', pwm)
    plausible.refuse_commands('log: m', pwm[:0])
    pwm[4, 3] = 65536.0
    with pytest.raises(BagError, match='^log: m: 5 of 400 motor commands .* such as -1:'):
        plausible.refuse_commands('log: m', pwm)


def turned(path, angle):
    return path @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize('angle', [0.0, 1.0, 3.0])
def test_a_mirror_image_of_the_path_is_told(angle):
    path = np.column_stack([np.cos(0.7 * T), np.sin(0.7 * T)])
    seen = turned(path, angle) + [3.0, -2.0]
    assert plausible.mirrored(path, seen) is None
    for wrong in (seen[:, ::-1], seen * [1.0, -1.0]):
        assert 'mirror image of the path' in plausible.mirrored(path, wrong)


def test_a_path_that_tells_nothing_is_no_mirror_image():
    path = np.column_stack([np.cos(0.7 * T), np.sin(0.7 * T)])
    line, drift = np.column_stack([T, 0.5 * T]), path + np.column_stack([T, -0.4 * T])
    for own, seen in ((line, line[:, ::-1]), (drift, path[:, ::-1]), (path, 0.01 * path[:, ::-1]),
                      (0.0 * path, path), (path[:20], path[:20, ::-1]), (path[:0], path[:0])):
        assert plausible.mirrored(own, seen) is None
        assert plausible.other_scale(own, seen) is None


@pytest.mark.parametrize(('factor', 'text'), [
    (0.7, '0.7 times'), (0.85, None), (1.0, None), (1.2, None), (1.4, '1.4 times'),
    (1000.0, '1e+03 times')])
def test_another_scale_of_the_path_is_told(factor, text):
    path = np.column_stack([np.cos(0.7 * T), np.sin(0.7 * T)])
    said = plausible.other_scale(path, factor * turned(path, 2.0))
    assert text in said if text else said is None
    assert plausible.other_scale(path, factor * path[:, ::-1]) is None  # another path


def test_a_path_of_another_flight_is_told_from_a_turned_and_scaled_one():
    t = np.linspace(0.0, 20.0, 500)
    circle = np.stack([np.cos(t), np.sin(t)], axis=1)
    eight = np.stack([np.sin(0.7 * t), np.sin(1.4 * t)], axis=1)
    turned = 0.8 * circle @ np.array([[0.6, -0.8], [0.8, 0.6]]) + [3.0, 1.0]
    assert plausible.alike(circle, turned) == pytest.approx(1.0)
    assert plausible.alike(circle, eight) < 0.1
    assert plausible.alike(circle, 0.05 * eight) == 1.0  # it hardly moves


@pytest.mark.parametrize(('step', 'found'), [(0.1, 0.1), (0.01, 0.01), (0.001, 0.0), (1e-6, 0.0)])
def test_rounded_positions_are_told(step, found):
    t = np.linspace(0.0, 30.0, 3000)
    path = np.stack([np.cos(t), np.sin(t), 1.0 + 0.2 * np.sin(0.3 * t)], axis=1)
    assert plausible.rounded(np.round(path / step) * step) == pytest.approx(found)
