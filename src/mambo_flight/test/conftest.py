"""Fixtures that several folders of tests share."""

from course_commands import FAST
from matplotlib.figure import Figure
import pytest


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
