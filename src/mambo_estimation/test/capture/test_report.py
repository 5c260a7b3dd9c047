"""What the estimator says of the motion capture."""

from mambo_estimation.capture import aided, report
from mambo_estimation.estimate import BAD, DOUBTFUL, GOOD
import pytest


def seen(**given):
    return aided.START._replace(located=True, trouble=aided.GOOD, **given)


@pytest.mark.parametrize('capture, text', [
    (seen(age=0.2), ''),
    (seen(age=1.5, silence=1.5), 'no motion capture for 1.5 s'),
    (seen(age=2.0)._replace(trouble=aided.POSITION_OFF, off=1.204),
     'motion capture refused for 2.0 s: position 1.20 m off'),
    (seen(age=2.0)._replace(trouble=aided.ATTITUDE_OFF),
     'motion capture refused for 2.0 s: attitude off, as by a flip'),
    (aided.START._replace(age=0.5),
     'motion capture refused for 0.5 s: the first ones do not agree')])
def test_complaint(capture, text):
    assert report.complaint(capture, 0.25) == text


@pytest.mark.parametrize(('age', 'told'), [(0.9, False), (1.0, True), (31.0, True)])
def test_a_long_time_without_poses_is_told_at_the_end(age, told):
    said = report.complaint(seen(age=age), 0.25)
    line = f'the estimate went on without poses until t = 34.00 s: {said}'
    assert report.longest(34.0, age, said) == line * told
    assert not report.longest(34.0, age, '')


def test_status_is_no_better_than_before_and_names_the_numbers():
    for level, want in ((GOOD, DOUBTFUL), (BAD, BAD)):
        found = report.added((level, 'nominal', {'height [m]': 1.0}), seen(
            age=3.0, silence=3.0, used=7, refused=2), 0.25)
        assert found[:2] == (want, 'nominal; no motion capture for 3.0 s')
        assert found[2]['poses used'] == 7 and found[2]['height [m]'] == 1.0
    well = report.added((GOOD, 'nominal', {}), seen(age=0.0), 0.25)
    assert well[:2] == (GOOD, 'nominal')
