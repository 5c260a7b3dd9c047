"""
Every figure of the thesis, remade from simulated data, with its claim and a verdict.

There is one module per chapter. Each figure is a function that flies, measures and draws.
``mambo reproduce`` runs them all and writes a report; its ``reproduction.md`` is
``docs/evidence/reproduction.md``.
"""
