"""The committed flight and figures show what the code of today makes."""

import hashlib
from pathlib import Path
import sys

from mambo_analysis.compare import digest
from mambo_thesis.drift import report
from matplotlib.figure import Figure
import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import remake  # noqa: E402 (a tool, no package)


def sha256(bag):
    return [hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(bag.iterdir())]


def test_the_committed_bag_is_the_flight_of_today(tmp_path):
    assert sha256(ROOT / 'bags/circle_short') == sha256(remake.circle_short(tmp_path)), \
        'stale: run tools/remake.py bags/circle_short'


@pytest.mark.long
def test_the_figure_of_the_readme_is_the_flight_of_today(tmp_path):
    assert digest.saved(ROOT / 'docs/images/circle.png') == digest.digest(
        remake.circle_figure(tmp_path)), 'stale: run tools/remake.py docs/images/circle.png'


def test_the_figure_of_the_drift_shows_the_table_beside_it():
    lines = (ROOT / 'docs/evidence/drift.md').read_text().splitlines()
    begin = lines.index(report.flown_table({}).splitlines()[0])
    end = next(k for k in range(begin, len(lines)) if not lines[k].startswith('|'))
    assert digest.saved(ROOT / 'docs/evidence/drift.png') == report.figure_digest(
        '\n'.join(lines[begin:end])), 'stale: run tools/remake.py docs/evidence/drift.png'


def figure(y=1.0, colour='k', label='a', bar=2.0):
    made = Figure()
    axes = made.subplots()
    axes.plot([0.0, 1.0], [0.0, y], color=colour, label=label)
    axes.bar([0.0], [bar], color=colour)
    return made


@pytest.mark.parametrize('change', [{'y': 1.001}, {'colour': 'r'}, {'label': 'b'}, {'bar': 2.1}])
def test_a_digest_changes_with_what_is_shown(change):
    assert digest.digest(figure()) == digest.digest(figure())
    assert digest.digest(figure(**change)) != digest.digest(figure())


def test_a_png_keeps_its_digest(tmp_path):
    digest.save(figure(), tmp_path / 'a.png', 50)
    figure().savefig(tmp_path / 'b.png')
    assert digest.saved(tmp_path / 'a.png') == digest.digest(figure())
    assert digest.saved(tmp_path / 'b.png') is None
