"""
Fly, sweep, open, estimate and compare from a script or a notebook.

>>> import mambo
>>> flight = mambo.fly(trajectory='circle', duration=20.0)
>>> bag = flight.save('bags/my_circle')
>>> mambo.compare(bag)

Nothing here needs a running ROS, except for :func:`command`. Wrong input raises
:class:`InputError`, whose text is one line.
"""

from mambo_bags.reader import Bag, Messages
from mambo_flight.scenario import Scenario
from mambo_model.errors import InputError, JobError, MamboError

from .commands import command, recorded_commands
from .flights import Flight, fly
from .recordings import compare, Comparison, estimate, Estimate, open_bag
from .sweeps import sweep

__all__ = [
    'Bag', 'command', 'compare', 'Comparison', 'estimate', 'Estimate', 'Flight', 'fly',
    'InputError', 'JobError', 'MamboError', 'Messages', 'open_bag', 'recorded_commands',
    'Scenario', 'sweep']
