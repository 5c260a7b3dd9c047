"""Chapters 2 and 3 before the controller: kinematics of the camera, signs of motors, drag."""

from mambo_thesis.figures import chapter_2
import numpy as np
import pytest


@pytest.mark.parametrize('figure', [
    chapter_2.figure_2_1, chapter_2.figure_3_1, chapter_2.figure_3_2])
def test_claims_without_a_flight_hold(figure):
    found = figure().measured
    assert found and all(m.holds for m in found), [str(m) for m in found if not m.holds]


def test_a_flow_of_the_other_sign_is_seen(monkeypatch):
    right = chapter_2.image_flow
    monkeypatch.setattr(chapter_2, 'image_flow', lambda p, v, w, f: right(
        p, v, tuple(-x for x in w), f))
    measured, = chapter_2.figure_2_1().measured
    assert not measured.holds and measured.high > 0.1


@pytest.mark.parametrize('axis', range(3))
def test_a_mixer_with_a_wrong_sign_is_counted(monkeypatch, axis):
    right = chapter_2.mix

    def wrong(thrust, vv):
        total, tau = right(thrust, vv)
        return total, tuple(-t if k == axis else t for k, t in enumerate(tau))
    monkeypatch.setattr(chapter_2, 'mix', wrong)
    measured, = chapter_2.figure_3_1().measured
    assert (measured.low, measured.holds) == (4.0, False)  # of twelve, one for each motor


def test_the_drag_is_drawn_by_part_over_the_speed():
    axes, = chapter_2.figure_3_2().figure.axes
    curves = {line.get_label(): line.get_xydata() for line in axes.lines[:-1]}
    parts = ('blade flapping', 'induced', 'translational', 'profile', 'parasitic')
    total = np.sum([curves[name][:, 1] for name in parts], axis=0)
    np.testing.assert_allclose(curves['sum'][:, 1], total, rtol=1e-9, atol=1e-12)
    assert (np.diff(curves['parasitic'][:, 1]) > 0.0).all()
    assert axes.get_xlabel() == 'horizontal speed [m/s]'


def by_what(result):
    return {m.what: m for m in result.measured}


def test_rotor_drag_that_bends_below_w_is_not_linear(monkeypatch):
    right = chapter_2.drag
    monkeypatch.setattr(chapter_2, 'drag', lambda nu, *rest: tuple(
        x * (1.0 + 0.1 * nu[0]) for x in right(nu, *rest)))
    bend = by_what(chapter_2.figure_3_2())[
        'rotor drag below w, relative deviation from a straight line']
    assert not bend.holds and bend.high > 0.01


def test_rotor_drag_that_stays_on_its_line_above_w_fails_the_claim(monkeypatch):
    slope = 0.02
    monkeypatch.setattr(chapter_2, 'drag', lambda nu, *rest: (-slope * nu[0], 0.0, 0.0))
    monkeypatch.setattr(chapter_2.air, 'parasitic_drag', lambda nu, k: (0.0, 0.0, 0.0))
    found = by_what(chapter_2.figure_3_2())
    assert found['rotor drag below w, relative deviation from a straight line'].holds
    beyond = found['rotor drag at 1.6 w, relative shortfall from that line']
    assert not beyond.holds and beyond.low == pytest.approx(0.0, abs=1e-12)


def test_a_frame_with_much_drag_fails_the_claim(monkeypatch):
    right = chapter_2.air.parasitic_drag
    monkeypatch.setattr(chapter_2.air, 'parasitic_drag', lambda nu, k: tuple(
        10.0 * x for x in right(nu, k)))
    share = by_what(chapter_2.figure_3_2())['share of the frame in the drag up to 2 m/s']
    assert not share.holds and share.high > 0.5
