"""The time of a controller's step: the least of five runs, the compiling one left out."""

from mambo_flight.race import timing
from mambo_flight.race.timing import step_time
from mambo_flight.scenario import Scenario
import pytest


@pytest.fixture
def clock(monkeypatch):
    """Return (counts, took): how often was answered, and how long each run takes in s."""
    counts, took = [], []

    def repeat(memory, state, ref, dt, gains, vv, count):
        counts.append(count)
    monkeypatch.setattr(timing, '_repeat', repeat)
    monkeypatch.setattr(timing.time, 'process_time', lambda: sum(took[:len(counts)]))
    return counts, took


def test_it_is_the_least_of_five_runs_of_many_steps_in_us(clock):
    counts, took = clock
    took += [9.0, 0.10, 0.08, 0.06, 0.12, 0.2]
    assert step_time(Scenario()) == pytest.approx(1e6 * 0.06 / 20_000)
    assert counts == [1] + [20_000] * 5


def test_the_first_answer_compiles_and_does_not_count(clock):
    _, took = clock
    took += [1e-9, 0.10, 0.08, 0.06, 0.12, 0.2]  # compiled before: quicker than any other
    assert step_time(Scenario()) == pytest.approx(3.0)


@pytest.mark.parametrize('slow', range(1, 6))
def test_one_run_that_is_disturbed_does_not_count(clock, slow):
    _, took = clock
    took += [1.0, *[0.06] * 5]
    took[slow] = 5.0
    assert step_time(Scenario()) == pytest.approx(3.0)


def test_the_time_is_that_of_this_process_alone(clock, monkeypatch):
    """Wall time would count what other processes do."""
    _, took = clock
    took += [1.0, *[0.06] * 5]
    monkeypatch.setattr(timing.time, 'perf_counter', lambda: pytest.fail('wall time'))
    monkeypatch.setattr(timing.time, 'monotonic', lambda: pytest.fail('wall time'))
    assert step_time(Scenario()) == pytest.approx(3.0)
