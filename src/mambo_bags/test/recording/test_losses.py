"""What a bag lacks at its end is found by the watermark and by /clock."""

from mambo_bags.recording.losses import LATE, Losses
from mambo_ros import messages
import pytest

COUNTED = ('/imu', '/sonar', '/flow', '/pressure')
END = 10_000_000_000  # ns


def recording(*counts):
    """Return the losses after watermarks with these counts, of which each was recorded."""
    losses, recorded = Losses(COUNTED, ('/imu', '/pwm')), []
    take = losses.counting(recorded.append)
    for k, count in enumerate(counts):
        take(messages.sensor_tick(5_000_000 * k, *count))
    assert len(recorded) == len(counts)
    return losses


FEW = {'/imu': 20, '/sonar': 4, '/flow': 5, '/pressure': 6}


@pytest.mark.parametrize(('counts', 'received', 'said'), [
    ([(1, 1, 0, 0), (20, 4, 5, 6)], FEW, []),
    ([(1, 1, 0, 0), (20, 4, 5, 7)], FEW, [
        '/pressure: the bag has 6 of the 7 messages that were published']),
    ([(1, 1, 0, 0), (21, 4, 9, 6)], FEW, [
        '/imu: the bag has 20 of the 21 messages that were published',
        '/flow: the bag has 5 of the 9 messages that were published']),
    ([(1, 0, 0, 0), (20, 9, 5, 6)], {'/imu': 20}, []),  # the others are not recorded
    ([(400, 50, 0, 0), (420, 53, 5, 6)], FEW, []),  # it came later
    ([], FEW, [])])
def test_samples_that_were_published_and_are_not_there_are_told(counts, received, said):
    assert list(recording(*counts).lines(received, END)) == said


@pytest.mark.parametrize(('end', 'now', 'told'), [
    (END - LATE, END, False), (END - LATE - 1, END, True), (END, END, False), (0, None, False)])
def test_a_topic_of_every_step_that_ends_before_the_clock_is_told(end, now, told):
    losses = recording()
    losses.ends |= {'/imu': END, '/sonar': 0, '/pwm': end}
    assert list(losses.lines({}, now)) == [
        f'/pwm: the bag has no message after {1e-9 * end:.3f} s, and the flight went on to '
        '10.000 s'] * told


def test_a_sensor_that_failed_for_good_is_no_loss():
    losses = recording((1, 1, 0, 0), (20, 4, 5, 6))
    losses.ends |= {'/imu': 0, '/pwm': 0}
    assert list(losses.lines(FEW, END)) == [
        '/pwm: the bag has no message after 0.000 s, and the flight went on to 10.000 s']


def test_a_watermark_that_is_too_short_is_left_out():
    losses = recording((1, 0, 0, 0))
    losses.counting(bytes)(b'\0\1\0\0')
    assert list(losses.lines(FEW, END)) == []
