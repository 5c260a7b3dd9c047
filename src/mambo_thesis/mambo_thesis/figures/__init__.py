"""
The thesis again: every figure from simulated data, its claim beside it, and a verdict.

One module per chapter; a figure is a function that flies, measures and draws. ``ros2 run
mambo_thesis reproduce`` runs them all and writes ``docs/evidence/reproduction.md`` and a report.
"""
