"""A reference flown in closed loop: it arrives, lags as its gains say, and obeys its estimate."""

from flown import steered, TRUE
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.twin.loop import Cascade, doubts, FIRMWARE, fly, Gains, has_estimate, table
from mambo_analysis.twin.recorded import Onboard
import numpy as np
import pytest

STRAIGHT = TRUE._replace(tilt=(0.0, 0.0))


def recording(reference, wrong=(0.0, 0.0, 0.0), seconds=12.0):
    """Return a flight with a reference, and an estimate that is wrong by a constant."""
    one = steered(seconds=seconds, model=STRAIGHT)
    wanted = np.broadcast_to(np.asarray(reference, float), one.position.shape)
    return one._replace(onboard=Onboard(
        wanted, one.position + wrong, one.velocity, one.attitude))


@pytest.mark.long
def test_it_arrives_at_a_constant_reference():
    end = fly(recording([0.4, -0.3, 1.2]), STRAIGHT, False).position[-1]
    assert end[:2] == pytest.approx([0.4, -0.3], abs=0.01)
    assert end[2] == pytest.approx(1.2, abs=0.05)  # the integral of the height is slow


@pytest.mark.long
def test_behind_a_moving_reference_it_stays_by_the_position_gain():
    """Velocity is asked for by the position error alone: v / (2 1/s), and the drag a little."""
    t = steered().t
    moving = np.column_stack([0.4 * t, 0.0 * t, 1.0 + 0.0 * t])
    one = recording(moving)
    lag = moving[-1, 0] - fly(one, STRAIGHT, False).position[-1, 0]
    assert lag == pytest.approx(0.4 / FIRMWARE.position, rel=0.1)
    quick = fly(one, STRAIGHT, False, FIRMWARE._replace(position=4.0)).position[-1, 0]
    assert moving[-1, 0] - quick == pytest.approx(0.1, rel=0.15)


@pytest.mark.long
def test_it_obeys_its_estimate():
    one = recording([0.0, 0.0, 1.0], wrong=(0.1, -0.05, 0.0))
    true, own = (fly(one, STRAIGHT, mistaken).position[-1] for mistaken in (False, True))
    assert own - true == pytest.approx([-0.1, 0.05, 0.0], abs=0.01)


@pytest.mark.long
def test_it_begins_at_the_recorded_state_with_the_integrals_of_the_flight():
    one = recording([0.0, 0.0, 1.0])
    later = one._replace(air=slice(400, len(one.t)))
    flown = fly(later, STRAIGHT, False)
    assert flown.position[0] == pytest.approx(one.position[400])
    assert flown.velocity[0] == pytest.approx(one.velocity[400])
    fresh = one._replace(command=one.command * (np.arange(len(one.t)) >= 400)[:, None],
                         air=later.air)
    assert np.abs(fly(fresh, STRAIGHT, False).position - flown.position).max() > 0.01


def test_commands_and_tilts_stay_within_their_limits():
    law = Cascade(Gains())
    roll, pitch, command = law.position((9.0, 9.0, 9.0), (0.0, 0.0, 0.0), (-3.0, -3.0, -3.0), 0.0)
    assert np.degrees([roll, pitch]) == pytest.approx([-20.0, 20.0]) and command == 65535.0
    assert law.position((0.0, 0.0, -9.0), (0.0,) * 3, (0.0, 0.0, 3.0), 0.0)[2] == 20000.0


def test_rms_is_horizontal_vertical_and_total():
    one = recording([0.0, 0.0, 1.0])
    flown = fly(one, STRAIGHT, False)
    shifted = flown._replace(position=one.position[one.air] + [0.03, 0.04, 0.12])
    assert shifted.rms(one) == pytest.approx((0.05, 0.12, 0.13))
    assert table([(one, shifted, None)])[2] == [
        [one.name, '5.0', '12.0', '13.0', '-', '-', '-']]


@pytest.mark.long
def test_what_is_missing_or_elsewhere_is_named():
    one = recording([0.0, 0.0, 1.0])
    with pytest.raises(IdentifyError, match='no reference'):
        fly(one._replace(onboard=None), STRAIGHT, False)
    unknown = one.onboard._replace(position=np.full_like(one.position, np.nan))
    assert has_estimate(one) and not has_estimate(one._replace(onboard=unknown))
    with pytest.raises(IdentifyError, match='no estimate'):
        fly(one._replace(onboard=unknown), STRAIGHT, True)
    with pytest.raises(IdentifyError, match='0.80 m beside the motion'):
        fly(recording([0.0, 0.0, 1.0], wrong=(0.8, 0.0, 0.0)), STRAIGHT, True)


def test_the_heading_turns_what_is_asked_for():
    """A drone that looks along y answers a reference along y by pitch, one along x by roll."""
    ahead = Cascade(Gains()).position((0.0, 0.3, 0.0), (0.0,) * 3, (0.0,) * 3, 0.5 * np.pi)
    aside = Cascade(Gains()).position((0.3, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, 0.5 * np.pi)
    assert ahead[1] == pytest.approx(np.radians(0.6 * 25.01)) and abs(ahead[0]) < 1e-9
    assert aside[0] == pytest.approx(np.radians(0.6 * 25.01)) and abs(aside[1]) < 1e-9


def test_a_tilt_is_answered_by_its_rate_and_the_integral_grows():
    law = Cascade(Gains())
    first = law.rates((0.1, -0.2), (0.0, 0.0))
    assert first == pytest.approx([0.6 + 0.003, -1.2 - 0.006])
    assert law.rates((0.1, -0.2), (0.0, 0.0)) == pytest.approx([0.606, -1.212])


@pytest.mark.long
def test_a_weak_battery_is_made_up_for_by_the_command():
    """With 3 % less voltage than the model knows it sags, and comes back."""
    one = recording([0.0, 0.0, 1.0])
    weak = one._replace(voltage=0.97 * one.voltage, air=slice(0, len(one.t)))
    flown, tired = (fly(x, STRAIGHT, False).position[:, 2] for x in (one, weak))
    assert (tired - flown).min() < -0.005
    assert abs(tired[-1] - flown[-1]) < 0.5 * np.abs(tired - flown).max()


@pytest.mark.long
def test_a_battery_that_is_not_known_is_that_of_the_model():
    one = recording([0.0, 0.0, 1.0])
    unknown = one._replace(voltage=np.full(len(one.t), np.nan))
    same = one._replace(voltage=np.full(len(one.t), STRAIGHT.voltage))
    assert np.allclose(fly(unknown, STRAIGHT, False).position, fly(same, STRAIGHT, False).position)


def test_what_makes_the_loop_another_one_is_told():
    one = recording([0.0, 0.0, 1.0])
    own, begin = one.onboard, slice(200, one.air.stop)
    real = one._replace(air=begin, onboard=own._replace(reference=one.position + 0.1))
    assert doubts(real) == []
    line, = doubts(real._replace(onboard=own._replace(reference=one.position + [1.5, 0.0, 0.0])))
    assert 'the reference is 1.50 m from the flight (median)' in line
    line, = doubts(real._replace(onboard=real.onboard._replace(
        position=own.position + [0.0, 0.3, 0.0])))
    assert 'the estimate of the drone is 0.30 m from the flight' in line
    command = one.command.copy()
    command[:180] = 0.0  # 0.2 s with the motors on
    line, = doubts(real._replace(command=command))
    assert 'what is used begins in the air' in line
