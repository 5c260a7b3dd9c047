"""
Damaged files and command lines: each must end well or in one line, within bounds.

``kinds`` makes a good file of every format and damages it by its structure; ``attempt`` runs a
command on it in a forked process with limits and judges the end; ``campaign`` tries many.
"""

from pathlib import Path
import sys

ROOT = Path(__file__).resolve().parents[2]
for _package in ('mambo_bags', 'mambo_analysis'):  # makers of files that their tests use, too
    sys.path.append(str(ROOT / 'src' / _package / 'test'))
