"""A numeric option takes a number within its limits; anything else is refused with the limits."""

import argparse

from mambo_bags.cli.option_types import declared, real, SLOPE, TIME, whole, WORKERS
import pytest


@pytest.mark.parametrize('kind, text, value', [
    (real(0.0, 2.0), '0', 0.0), (real(0.0, 2.0), '2', 2.0),
    (real(0.0, 2.0, above=True), '1e-9', 1e-9),
    (whole(1, 16), '16', 16), (whole(1, 16), '1', 1),
    (declared(3, 1, 20), '7', 7), (declared(3.0, 1, 20), '7', 7.0)])
def test_a_number_within_its_limits_is_taken(kind, text, value):
    assert kind(text) == value and type(kind(text)) is type(value)


@pytest.mark.parametrize('kind, text, message', [
    (real(0.0, 2.0, 'm'), '2.1', '2.1 must be within 0 to 2 m'),
    (real(0.0, 2.0, 'm'), 'nan', 'nan must be within 0 to 2 m'),
    (real(0.0, 2.0), '-1e400', '-1e400 must be within 0 to 2'),
    (real(0.0, 2.0, 's', above=True), '0', '0 must be more than 0 and at most 2 s'),
    (real(0.0, 2.0), 'fast', "'fast' is not a number"),
    (whole(1, 16), '0', '0 must be within 1 to 16'),
    (whole(1, 16), '17', '17 must be within 1 to 16'),
    (whole(1, 16), '2.5', "'2.5' is not a whole number"),
    (declared(3, 1, 20), '7.5', "'7.5' is not a whole number"),
    (declared(1.0, 0, 1, '1'), '2', '2 must be within 0 to 1'),
    (declared(1.0, 0, 1, 'm/s', True), '0', '0 must be more than 0 and at most 1 m/s')])
def test_anything_else_is_refused_with_the_limits(kind, text, message):
    with pytest.raises(argparse.ArgumentTypeError) as error:
        kind(text)
    assert str(error.value) == message


def test_a_number_of_many_digits_is_refused():
    for kind, text in ((whole(1, 16), '9' * 9000), (real(0.0, 1.0), '9' * 9000)):
        with pytest.raises(argparse.ArgumentTypeError):
            kind(text)


@pytest.mark.parametrize('text', ['-1e12', '0', '1e12', '1700000000.25'])
def test_times_of_recordings_are_taken(text):
    assert TIME(text) == float(text)


@pytest.mark.parametrize('kind, text', [
    (TIME, 'inf'), (TIME, '2e12'), (SLOPE, '101'), (SLOPE, 'nan'),
    (WORKERS, '0'), (WORKERS, '1025'), (WORKERS, '-1')])
def test_shared_types_have_limits(kind, text):
    with pytest.raises(argparse.ArgumentTypeError):
        kind(text)
