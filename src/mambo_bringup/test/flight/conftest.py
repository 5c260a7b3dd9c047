"""Flights of stand-in nodes."""

from mambo_bringup import processes
import pytest
from stand_in_nodes import NODES, QUIET, STAND_IN


@pytest.fixture
def graph(tmp_path, monkeypatch):
    """Return what replaces installed nodes by other programs; they begin when all are up."""
    monkeypatch.setattr(processes, 'executable', lambda package, name: tmp_path / name)
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)

    def replace(**programs):
        for told in (*tmp_path.glob('*.up'), *tmp_path.glob('*.quiet')):
            told.unlink()  # by those of the flight before, for which nobody waits any more
        for name in {*NODES, *programs}:
            (tmp_path / name).write_text(STAND_IN + programs.get(name, QUIET))
            (tmp_path / name).chmod(0o755)
    return replace
