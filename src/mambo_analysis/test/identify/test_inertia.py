"""Moments of inertia from swings, simulated and real."""

import json
from pathlib import Path

from interval_checks import assert_covers
from mambo_analysis.identify.inertia import fit_swing, Geometry, main
from mambo_analysis.identify.regression import IdentifyError
from mambo_model.vehicle import bifilar, parameters
import numpy as np
import pytest
from scipy.integrate import solve_ivp

DATA = Path(__file__).parents[5] / 'shared/data/crazyflie_optitrack'
RIG = Geometry(mass=0.068, separation=0.1, length=0.5)
K_D, C, NOISE = 2e-6, 6e-6, 0.02
T = np.arange(0.0, 20.0, 0.01)


def swing(J, seed=0, bias=0.05, theta=0.5):
    """Return the gyro of (4.2), by another integrator than that of the fit."""
    m, g, D, h = RIG.mass, RIG.gravity, RIG.separation, RIG.length

    def derivative(_, x):
        drop = np.sqrt(1.0 - 0.5 * (D / h) ** 2 * (1.0 - np.cos(x[0])))
        return [x[1], -(K_D / J * abs(x[1]) + C / J) * x[1]
                - m * g * D * D / (4.0 * J * h) * np.sin(x[0]) / drop]
    rate = solve_ivp(derivative, (0.0, 20.0), [theta, 0.0], t_eval=T, rtol=1e-9, atol=1e-9).y[1]
    return rate + bias + NOISE * np.random.default_rng(seed).standard_normal(len(T))


@pytest.mark.parametrize('J', [6.9e-5, 7.75e-5, 1.5e-4])
@pytest.mark.parametrize('theta', [0.5, -0.4])
def test_the_axes_of_the_mambo_come_back(J, theta):
    found = fit_swing(T, swing(J, theta=theta), RIG)
    assert found.J.value == pytest.approx(J, rel=1e-3)  # 2 % asked; noise of the gyro allows 1e-4
    assert found.K_D.value == pytest.approx(K_D, rel=0.10)  # 2 sigma of the worst axis
    assert found.C.value == pytest.approx(C, rel=0.07)
    assert found.amplitude == pytest.approx(abs(theta), rel=0.05)
    assert found.bias == pytest.approx(0.05, abs=0.002)
    assert found.fit.order == (0,)


@pytest.mark.parametrize('arm', [0.05, 0.15])
def test_damping_about_a_horizontal_axis_is_of_the_moment_about_that_axis(arm):
    J, m, g = 5e-5, 0.063, 9.81
    about = J + m * arm ** 2
    quadratic, linear = K_D * about / J, C * about / J  # which decays as on two wires

    def derivative(_, x):
        return [x[1], (-quadratic * abs(x[1]) * x[1] - linear * x[1]
                       - m * g * arm * np.sin(x[0])) / about]
    rate = solve_ivp(derivative, (0.0, 20.0), [0.4, 0.0], t_eval=T, rtol=1e-9, atol=1e-9).y[1]
    rate = rate + NOISE * np.random.default_rng(1).standard_normal(len(T))
    rig = Geometry(m, arm)
    found = fit_swing(T, rate, rig)
    assert found.J.low <= J <= found.J.high
    assert found.K_D.low <= quadratic <= found.K_D.high
    assert found.C.low <= linear <= found.C.high
    assert found.K_D.value == pytest.approx(quadratic, rel=0.10)  # of J alone 4 and 29 times less
    assert found.C.value == pytest.approx(linear, rel=0.07)
    ruler = fit_swing(T, rate, rig._replace(separation_error=0.0005))
    assert ruler.K_D.half > found.K_D.half
    # dlnJ/dlnL = 1 - m L^2/J, dlnJ/dlnm = 1, by hand
    shares = rig.shares(np.sqrt(m * g * arm / about))
    assert shares.keys() == {'D', 'mass'} and shares['mass'] == pytest.approx(1.0)
    assert shares['D'] == pytest.approx(1.0 - m * arm ** 2 / J, rel=0.02)
    shares = RIG.shares(10.0)
    assert (shares['D'], shares['h'], shares['mass']) == pytest.approx((2.0, -1.0, 1.0), abs=0.02)


@pytest.mark.long
def test_intervals_cover_over_60_seeds():
    J, (w, d, c) = 7.75e-5, (None, K_D, C)
    w = np.sqrt(RIG.mass * RIG.gravity * RIG.separation ** 2 / (4.0 * J * RIG.length))
    clean = bifilar.swing(T, 0.5, 0.0, bifilar.Swing(w, d / J, c / J, 0.2))
    found = [fit_swing(T, clean + NOISE * np.random.default_rng(seed).standard_normal(len(T)), RIG)
             for seed in range(60)]
    assert_covers(J, [one.J for one in found])
    assert_covers(C, [one.C for one in found])
    assert_covers(K_D, [one.K_D for one in found])


def test_errors_of_the_rig_widen_the_interval_as_they_should():
    rate = swing(7.75e-5)
    sure = fit_swing(T, rate, RIG).J
    ruler = fit_swing(T, rate, RIG._replace(separation_error=0.001)).J
    assert sure.half < 1e-4 * sure.value
    # 1 mm of 100 mm is 2 % of J, and 1.96 of it make 95 %
    assert ruler.half == pytest.approx(1.96 * 0.0201 * ruler.value, rel=0.01)
    scale = fit_swing(T, rate, RIG._replace(mass_error=0.00068, length_error=0.005)).J
    assert scale.half == pytest.approx(1.96 * np.hypot(0.01, 0.0099) * scale.value, rel=0.01)


@pytest.mark.parametrize('change, message', [
    (lambda t, r: (t, np.where(t == 3.0, np.nan, r)), 'gyro is not finite in 1 of 2000'),
    (lambda t, r: (t[:40], r[:40]), '40 samples, at least 50'),
    (lambda t, r: (t[:100], r[:100]), r'1.\d swings in 1.0 s, at least 2'),
    (lambda t, r: (t, np.zeros_like(r)), 'constant: nothing swings'),
    (lambda t, r: (t, np.abs(r)), 'the gyro never changes its sign'),
    (lambda t, r: (t, r * 180.0 / np.pi), 'is the gyro in deg/s'),
    (lambda t, r: (t, np.random.default_rng(1).standard_normal(len(t))), r'explains \d % of'),
    (lambda t, r: (t[::-1], r), 'time does not rise')])
def test_what_is_no_swing_is_refused_in_one_line(change, message):
    with pytest.raises(IdentifyError, match=message) as error:
        fit_swing(*change(T, swing(7.75e-5)), RIG)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('share', [0.5, 0.8, 0.93])
@pytest.mark.parametrize('written', [lambda x: x, lambda x: x.round(3), np.float32],
                         ids=['floats', 'rounded', 'single precision'])
def test_a_gyro_at_its_limit_is_refused(share, written):
    rate = swing(7.75e-5, bias=0.0)
    limit = share * np.abs(rate).max()
    for low in (-limit, -np.inf):
        with pytest.raises(IdentifyError, match=r'\d+ samples from .* s on stand at -?\d.* rad/s: '
                                                'the gyro is at its limit'):
            fit_swing(T, written(np.clip(rate, low, limit)), RIG)


@pytest.mark.parametrize('step', [0.0, 1e-4, 0.01, 0.1])
@pytest.mark.parametrize('noise', [0.0, 1.0])
def test_a_coarse_gyro_is_not_at_its_limit(step, noise):
    rate = swing(7.75e-5, bias=0.0) - (1.0 - noise) * (
        NOISE * np.random.default_rng(0).standard_normal(len(T)))
    rough = np.round(rate / step) * step if step else rate
    assert fit_swing(T, rough, RIG).J.value == pytest.approx(7.75e-5, rel=2e-3)


@pytest.mark.parametrize('change, said', [
    ({}, ''),
    ({'separation': 10.0, 'length': 50.0}, 'the radius of gyration is 338 mm, 7.19 times'),
    ({'separation': 0.03}, 'the radius of gyration is 10.1 mm, 0.216 times that of identified'),
    ({'mass': 0.9}, 'the mass is 13.2 times that of identified: check --mass')])
def test_a_rig_in_another_unit_is_told(tmp_path, capsys, change, said):
    np.savetxt(tmp_path / 'swing.csv', np.stack([T, swing(7.75e-5)], axis=1), header='t,gyro.z',
               delimiter=',', comments='')
    rig = {'mass': RIG.mass, 'separation': RIG.separation, 'length': RIG.length} | change
    assert main([str(tmp_path / 'swing.csv'), '--axis', 'z', *(
        f'--{name}={value}' for name, value in rig.items())]) == 0
    out = capsys.readouterr().out
    assert said in out and (said or 'check --' not in out)


def test_a_jump_of_the_clock_is_refused():
    jumped = np.where(T > 10.0, T + 1.0, T)
    with pytest.raises(IdentifyError, match='no sample from 10 to 11.01 s'):
        fit_swing(jumped, swing(7.5e-5))
    kept = (T < 10.0) | (T > 10.05)  # a few lost samples are none
    assert fit_swing(T[kept], swing(7.5e-5)[kept]).linear.value > 0.0


@pytest.mark.long
@pytest.mark.parametrize('theta, factor, message', [
    (0.03, 180.0 / np.pi, 'is the gyro in deg/s? then give --unit deg/s'),
    (0.5, np.pi / 180.0, 'is the gyro in rad/s? then give no --unit')])
def test_a_swing_in_another_unit_is_told_by_its_decay(theta, factor, message):
    """Of 1.7 deg taken for 1.7 rad J would be 15 % too small; of 0.5 rad taken for deg 1 %."""
    with pytest.raises(IdentifyError) as error:
        fit_swing(T, factor * swing(7.75e-5, theta=theta), RIG)
    assert message in str(error.value)
    found = fit_swing(T, swing(7.75e-5, theta=theta), RIG)
    assert found.J.value == pytest.approx(7.75e-5, rel=2e-3)


def csv(path, rate):
    np.savetxt(path, np.stack([T, rate], axis=1), header='t,gyro.y', delimiter=',', comments='')
    return path


def test_the_command_writes_a_vehicle_ready_to_fly(tmp_path, capsys):
    file = csv(tmp_path / 'swing.csv', np.rad2deg(swing(8.1e-5)))
    geometry = ['--separation', '0.1', '--length', '0.5', '--mass', '0.068']
    assert main([str(file), '--axis', 'y', '--unit', 'deg/s', *geometry,
                 '--out', str(tmp_path / 'out')]) == 0
    assert 'J_yy' in capsys.readouterr().out
    got = parameters.load(tmp_path / 'out/identify_inertia.yaml')
    base = parameters.preset('identified')
    assert got.inertia[1] == pytest.approx(8.1e-5, rel=1e-3)
    assert got.inertia[::2] == base.inertia[::2] and got.mass == base.mass
    assert (tmp_path / 'out/identify_inertia.png').stat().st_size > 10000


@pytest.mark.parametrize('options, message', [
    ([], 'is the gyro in deg/s'),
    (['--column', 'w'], 'no column w; it has t, gyro.y'),
    (['--time', 'when'], 'no column when; give --time t'),
    (['--unit', 'deg/s', '--separation', '0.1'], 'needs --length'),
    (['--unit', 'deg/s', '--separation', '0.1', '--length', '0.5'], 'needs --mass'),
    (['--unit', 'deg/s', '--rate', '50'], 'has times in its column t: leave it out'),
    (['--unit', 'deg/s', '--length', '0.5'], '--length: has no effect, as there is no moment'),
    (['--unit', 'deg/s', '--mass', '0.06'], '--mass: has no effect'),
    (['--unit', 'deg/s', '--base', 'toolbox'], '--base: has no effect'),
    (['--namespace', 'mambo'], '--namespace: has no effect'),
    (['--rig', 'physical', '--separation', '0.1', '--mass', '0.06', '--length', '0.5'],
     '--length: has no effect, as a physical pendulum has no wires'),
    (['--unit', 'deg/s', '--base', 'nobody'], "vehicle 'nobody' is unknown")])
def test_wrong_use_is_one_line(tmp_path, capsys, options, message):
    file = csv(tmp_path / 'swing.csv', np.rad2deg(swing(8.1e-5)))
    assert main([str(file), '--axis', 'y', *options]) == 2
    error = capsys.readouterr().err
    assert message in error and error.startswith('identify_inertia: ') and error.count('\n') == 1
    assert 'swing.csv' in error or error.startswith('identify_inertia: --')


@pytest.mark.parametrize('change, message', [
    (lambda t: t[::-1], 'column t: the time goes from 19.99 to 19.98 s in row 3: give times that'),
    (lambda t: np.roll(t, 700), 'column t: the time goes from 19.99 to 0 s in row 702'),
    (lambda t: 1e3 * t, 'column t: its samples are 10 s apart, too far for a motion'),
    (lambda t: 1e-6 * t, 'column t: its samples are 1e-08 s apart, too near')])
def test_times_that_cannot_be_name_file_column_and_row(tmp_path, capsys, change, message):
    """The rows before a step back were left out without a word."""
    file = tmp_path / 'swing.csv'
    np.savetxt(file, np.stack([change(T), swing(8.1e-5)], axis=1), header='t,gyro.z',
               delimiter=',', comments='')
    assert main([str(file)]) == 2
    error = capsys.readouterr().err
    assert f'identify_inertia: {file}: {message}' in error and error.count('\n') == 1


@pytest.mark.parametrize('options', [
    ['--unit', 'deg/s'], ['--column', 'w'], ['--time', 'when'], ['--rate', '200']])
def test_options_of_a_table_are_refused_for_a_bag(capsys, options):
    bag = Path(__file__).parents[4] / 'bags/circle_short'
    assert main([str(bag), *options]) == 2
    assert f'{options[0]}: has no effect, as {bag} is a bag' in capsys.readouterr().err


@pytest.mark.parametrize('name, text, message', [
    ('none.csv', None, 'No such file'), ('a.txt', 'x', 'is no .csv, .mat, .json file or bag'),
    ('a.csv', '', 'no column of numbers'), ('a.csv', 't,gyro.z\n1\n', 'row 2 has 1 fields'),
    ('a.csv', 't,gyro.z\n1,x\n', 'cannot be read'), ('a.mat', 'x', 'cannot be read'),
    ('a.json', '{', 'cannot be read'), ('a.json', '[]', 'no column of numbers')])
def test_broken_files_are_one_line(tmp_path, capsys, name, text, message):
    file = tmp_path / name
    if text is not None:
        file.write_text(text)
    assert main([str(file)]) == 2
    error = capsys.readouterr().err
    assert message in error and str(file) in error and error.count('\n') == 1


@pytest.mark.skipif(not DATA.is_dir(), reason='real recordings are not beside the checkout')
@pytest.mark.parametrize('axis, hertz', [('x', 2.357), ('y', 2.329), ('z', 2.081)])
def test_a_real_pendulum_shows_its_frequency_whatever_the_model(axis, hertz, capsys):
    file, = DATA.glob(f'*lab03_{axis}_data*.json')
    assert main([str(file), '--axis', axis, '--unit', 'deg/s', '--rig', 'physical', '--mass',
                 '0.035', '--json']) == 0
    output = json.loads(capsys.readouterr().out)
    omega = output['values']['omega_0']
    # crossings of zero, counted: swings of at most 0.45 rad last up to 0.45^2/16 = 1.3 % longer
    raw = json.loads(file.read_text())['drone'][f'gyro.{axis}']
    t, w = np.array(raw['time']), np.array(raw['data'])
    up = t[:-1][(w[:-1] < 0.0) & (w[1:] >= 0.0)]
    counted = (len(up) - 1) / (up[-1] - up[0])
    assert 0.998 < omega['value'] / (2.0 * np.pi) / counted < 1.013
    assert omega['value'] / (2.0 * np.pi) == pytest.approx(hertz, abs=0.002)
    assert output['facts']['J at most [kg m^2]'] < 4e-5
