"""Rates, noise, limits, outliers and delay of every sensor of a recording."""

from .command import main, measure

__all__ = ['main', 'measure']
