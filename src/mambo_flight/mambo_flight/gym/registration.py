"""Registration of the environments with Gymnasium."""

from __future__ import annotations

import gymnasium

_FOLDER = __name__.rpartition('.')[0]
IDS = {'mambo/Hover-v0': 'hover', 'mambo/Track-v0': 'track'}
"""Task of each id."""


def register() -> None:
    """Register the environments for ``gymnasium.make`` and ``gymnasium.make_vec``."""
    for name, task in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name, f'{_FOLDER}.environment:DroneEnv', kwargs={'task': task},
                vector_entry_point=f'{_FOLDER}.vector_environment:DroneVectorEnv')
