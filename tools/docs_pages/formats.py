"""Tables of the file formats that are data in the code: topics of an imported bag."""

from __future__ import annotations

from mambo_analysis.importers.any_bag import TARGETS
from mambo_flight import scenario_file

from .source import table


def import_targets() -> str:
    """Return the topics that an imported bag can have, with their types."""
    return table(('topic', 'type'), [(f'`{name}`', f'`{kind}`') for name, kind in TARGETS.items()])


def scenarios() -> str:
    """Return the scenarios that come with the package, with their flights."""
    rows = []
    for name in scenario_file.names():
        experiment = scenario_file.read(scenario_file.find(name))
        flights = ', '.join(f'`{name}/{flight}`' for flight in experiment.flights if flight)
        rows.append((f'`{name}`', experiment.title, flights))
    return table(('scenario', 'what', 'its flights'), rows)
