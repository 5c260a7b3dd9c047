"""Fixtures that several folders of tests share."""

from pathlib import Path

from course_commands import FAST
from matplotlib.figure import Figure
import pytest

PD = Path(__file__).parents[3] / 'examples/pd_controller.py'


@pytest.fixture
def fast(tmp_path):
    """Return the file of a course that is too fast for the vehicle."""
    path = tmp_path / 'fast.csv'
    path.write_text(FAST)
    return str(path)


@pytest.fixture
def figures_of(monkeypatch):
    """Return what collects the figures of a module, so that a test reads them, not pixels."""
    def collect(module):
        figures = []

        def make(*args, **options):
            figures.append(Figure(*args, **options))
            return figures[-1]
        monkeypatch.setattr(module, 'Figure', make)
        return figures
    return collect


@pytest.fixture(scope='session')
def faulty(tmp_path_factory):
    """
    Return a compiled controller that does wrong as its parameters say; compiled but once.

    It is the PD controller with another name of what it remembers; ``raises`` and ``hangs`` are
    the steps in flight at which it does.
    """
    text = PD.read_text().replace('steps', 'count')
    for old, new in (
            ('    largest_tilt', """    thrust_share: float = quantity(1.0, '1', 0.0, 1.0, 'test')
    raises: int = quantity(-1, '1', -1, 10_000, 'test')
    hangs: int = quantity(-1, '1', -1, 10_000, 'test')
    largest_tilt"""),
            ('    v = rotate(state.q, state.nu)\n', """    while memory.count == gains.hangs:
        pass
    if memory.count == gains.raises:
        raise ValueError('lost my way')
    v = rotate(state.q, state.nu)
"""),
            ('    return Memory(memory.count + 1), thrust', """    thrust *= gains.thrust_share
    return Memory(memory.count + 1), thrust""")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp('faulty') / 'faulty.py'
    path.write_text(text)
    return path
