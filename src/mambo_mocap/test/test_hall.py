"""The cameras of the server see what those of the mock see, at any rate."""

import math

from mambo_mocap.hall import content, fullest, Hall, label, model
from mambo_mocap.natnet import frame as frames, model as models
from mambo_mocap.natnet.frame import Times
from mambo_mocap.parameters import NatNetServerNodeParams
from mambo_model.motion.quaternion import exp_map
from mambo_model.motion.rigid_body import State
from mambo_sim import simulator
from mambo_sim.sensors import hall_capture, optitrack
from mambo_sim.sensors.hall_capture import HallCaptureParams
from mambo_sim.sensors.marker_occlusion import MarkerParams
import pytest

STEP = 5_000_000
HIDDEN = MarkerParams(occlusion=0.4, occlusion_time=0.05)


def truth(t):
    """Return a true state on a curve, t in ns."""
    s = t * 1e-9
    return State((math.sin(s), math.cos(2.0 * s), -1.5), (0.0,) * 3,
                 exp_map((0.1 * math.sin(3.0 * s), 0.1, s)), (0.0,) * 3)


def views(params, steps=400):
    hall = Hall(params)
    return [view for k in range(steps) for view, in hall.look(k * STEP, [truth(k * STEP)])]


@pytest.mark.parametrize('markers', [MarkerParams(), HIDDEN])
def test_the_poses_are_those_of_the_mock_to_the_bit(markers):
    found = views(NatNetServerNodeParams(markers=markers, seed=4))
    mock = optitrack.OptitrackParams(latency=0.0, markers=markers)
    rng, values = simulator.generators(4)[4], mock.values()
    memory, before, poses = optitrack.START, (0, truth(0)), {}
    for k in range(400):
        now = (k * STEP, truth(k * STEP))
        memory, sample = optitrack.step(memory, *before, *now, rng, values, None)
        before = now
        if sample.new:
            poses[sample.pose.exposure] = sample.pose
    tracked = {view.exposure: view for view in found if view.track.tracked}
    assert poses.keys() == tracked.keys() and len(poses) > 100
    for exposure, pose in poses.items():
        track = tracked[exposure].track
        assert (track.rho, track.q) == (pose.rho, pose.q)
    assert len(poses) == len(found) or markers is HIDDEN


@pytest.mark.parametrize('rate', [30.0, 120.0, 360.0, 1000.0])
def test_every_frame_is_exposed_once_at_any_rate(rate):
    params = NatNetServerNodeParams(rate=rate)
    found = views(params)
    assert [view.number for view in found] == list(range(1, len(found) + 1))
    assert [view.exposure for view in found] == [
        k * params.period for k in range(399 * STEP // params.period + 1)]


def test_a_frame_has_the_markers_where_they_are_seen():
    params = NatNetServerNodeParams(markers=HIDDEN, up='z', version='3.1')
    hidden = lost = 0
    for view in views(params):
        frame = content([view], params, Times(view.exposure * 1e-9))
        body, = frame.bodies
        of_body = [one for one in frame.labelled if one.identifier >> 16 == params.body_id]
        points = {(x, -y, -z) for x, y, z in view.points}
        seen = [one for one in frame.labelled if not one.flags & frames.OCCLUDED]
        assert {one.position for one in seen} == points
        assert body.tracked == view.track.tracked
        if body.tracked:
            assert len(of_body) == 5
            hidden += any(one.flags & frames.OCCLUDED for one in of_body)
            assert all(one.residual < params.markers.gate() for one in of_body)
        else:
            assert not of_body and len(frame.others) == len(points)
            lost += 1
        assert [len(one.positions) for one in frame.marker_sets] == [5, 5]
    assert hidden > 50 and lost > 5


@pytest.mark.parametrize(('fault', 'shift'), [('lost', None), ('flip', 0.0), ('swap', 0.7)])
def test_faults_of_the_cameras(fault, shift):
    right = NatNetServerNodeParams()
    wrong = NatNetServerNodeParams(
        fault=fault, fault_begin=0.5, fault_end=1.0, fault_distance=0.7)
    for a, b in zip(views(right), views(wrong), strict=True):
        if not 0.5 <= a.exposure * 1e-9 < 1.0:
            assert a == b
        elif fault == 'lost':
            assert not b.track.tracked and not b.points
        else:
            assert math.dist(a.track.rho, b.track.rho) == pytest.approx(shift)
            turn = abs(sum(x * y for x, y in zip(a.track.q, b.track.q, strict=True)))
            assert turn == pytest.approx(0.0 if fault == 'flip' else 1.0, abs=1e-9)


def test_the_definitions_have_the_markers_of_the_body():
    params = NatNetServerNodeParams(body='drone', body_id=7, up='z')
    one, every, body = model(params)
    assert one == models.MarkerSetModel('drone', tuple(f'Marker{k}' for k in range(1, 6)))
    assert every.name == 'all' and len(every.markers) == 5
    assert (body.name, body.identifier) == ('drone', 7)
    x, y, z = params.markers.five()[0]
    assert body.markers[0].position == (x, -y, -z)


def test_a_point_far_from_every_marker_has_no_label():
    places = [(float(k), 0.0, 0.0) for k in range(5)]
    assert label(((0.1, 0.0, 0.0), (9.0, 0.0, 0.0)), places, 0.4) == {0: (0, (0.1, 0.0, 0.0))}
    assert len(label(((0.1, 0.0, 0.0), (0.2, 0.0, 0.0)), places, 0.4)) == 1


PLACES = '0 0 0; 0.0 -2.0 0.0'  # z up: the second stands 2 m to the east
TWO = {'bodies': 'one=/one/ground_truth/odom, two=/two/ground_truth/odom', 'places': PLACES,
       'seed': 4}


def approaching(k):
    """Return the states of two drones that approach each other, at step k."""
    return [State((0.0, side * 0.02 * k, height), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
            for side, height in ((1.0, -1.0), (-1.0, -1.3))]


def frames_of(params, steps=60):
    hall = Hall(params)
    return [views for k in range(steps) for views in hall.look(k * STEP, approaching(k))]


def test_each_of_several_bodies_is_that_of_a_hall_of_its_own_to_the_bit():
    found = frames_of(NatNetServerNodeParams(**TWO))
    assert len(found) > 30
    for number in range(2):
        alone = Hall(NatNetServerNodeParams(seed=4 + number))
        assert [views[number] for views in found] == [
            view for k in range(60) for view, in alone.look(k * STEP, [approaching(k)[number]])]


@pytest.mark.long
@pytest.mark.parametrize('swap', [0.0, 0.5])
def test_what_drones_do_to_each_other_is_that_of_the_mock_to_the_bit(swap):
    shared = HallCaptureParams(
        occlusion=True, cameras=2, camera_height=1.0, body_height=0.5, swap_distance=swap)
    found = frames_of(NatNetServerNodeParams(**TWO, capture=shared))
    capture = hall_capture.HallCapture(
        shared, [(0.0, 0.0, 0.0), (0.0, 2.0, 0.0)], [MarkerParams().five()] * 2,
        NatNetServerNodeParams().period)
    mock = optitrack.OptitrackParams(latency=0.0)
    values, rngs = mock.values(), [simulator.generators(4 + number)[4] for number in range(2)]
    memory, before, poses = [optitrack.START] * 2, (0, approaching(0)), ({}, {})
    for k in range(60):
        now = (k * STEP, approaching(k))
        rows = capture.step(*now)
        for i in range(2):
            memory[i], sample = optitrack.step(
                memory[i], before[0], before[1][i], now[0], now[1][i], rngs[i], values, rows[i])
            if sample.new:
                poses[i][sample.stamp] = (sample.pose.rho, sample.pose.q)
        before = now
    assert bool(capture.exchanges) == bool(swap)
    for i in range(2):
        assert {views[i].exposure: (views[i].track.rho, views[i].track.q)
                for views in found if views[i].track.tracked} == poses[i]
    assert any(len(view.points) < 5 for views in found for view in views)


def test_a_frame_has_all_bodies_and_markers_where_they_are_in_the_hall():
    params = NatNetServerNodeParams(**TWO, body_id=7, up='z')
    views = frames_of(params)[0]
    frame = content(views, params, Times(0.0))
    assert [body.identifier for body in frame.bodies] == [7, 8]
    assert frame.bodies[0].position == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)
    assert frame.bodies[1].position == pytest.approx((0.0, -2.0, 1.3), abs=1e-3)
    assert [one.name for one in frame.marker_sets] == ['one', 'two', 'all']
    assert frame.marker_sets[2].positions == (
        frame.marker_sets[0].positions + frame.marker_sets[1].positions)
    assert [one.identifier for one in frame.labelled] == [
        number << 16 | k for number in (7, 8) for k in range(1, 6)]
    for one in frame.labelled:
        assert math.dist(one.position, frame.bodies[(one.identifier >> 16) - 7].position) < 0.1
    names = [one.name for one in model(params)]
    assert names == ['one', 'two', 'all', 'one', 'two']


def test_markers_of_bodies_that_are_not_found_are_numbered_through():
    params = NatNetServerNodeParams(**TWO, fault='flip', fault_end=9.0)
    views = [view._replace(track=view.track._replace(tracked=False))
             for view in frames_of(params)[0]]
    frame = content(views, params, Times(0.0))
    assert len(frame.others) == 10 and not any(body.tracked for body in frame.bodies)
    assert [one.identifier for one in frame.labelled] == list(range(50_001, 50_011))


def test_a_body_without_a_sample_is_not_tracked_and_comes_back():
    hall = Hall(NatNetServerNodeParams(**TWO))
    hall.look(0, approaching(0))
    (_, gone), = hall.look(2 * STEP, [approaching(2)[0], None])
    assert not gone.track.tracked and not gone.points
    (_, back), *_ = hall.look(4 * STEP, approaching(4))
    assert back.track.tracked


@pytest.mark.parametrize('fault', ['none', 'swap', 'flip', 'lost'])
def test_no_frame_is_longer_than_the_fullest(fault):
    params = NatNetServerNodeParams(fault=fault, fault_end=10.0, markers=HIDDEN)
    most = fullest(params)
    assert len(most.labelled) == 10 and len(most.others) == 5
    for view in views(params):
        frame = content([view], params, Times(0.0))
        for version in ((2, 7), (4, 2)):
            assert len(frames.encode_frame(frame, version)) <= len(
                frames.encode_frame(most, version))
