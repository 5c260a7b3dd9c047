"""Packets that Motive sent, and the version of the protocol of each."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[4] / 'shared/data/natnet_packets'
VERSIONS = {'1.5.0': (2, 5), '1.7.2': (2, 7), '1.9.0': (2, 9)}
FRAMES = {**{f'frame-motive-{motive}-00{number}': version
             for motive, version in VERSIONS.items() for number in (1, 2)},
          'mocapframe_packet_v3': (3, 0), 'mocapframe_packet_occluded_v3': (3, 0)}
INFOS = {**{f'frame-motive-{motive}-000': version for motive, version in VERSIONS.items()},
         'serverinfo_packet_v3': (3, 0)}


def packet(name):
    """Return the bytes of a recorded packet."""
    if not FOLDER.exists():
        pytest.skip(f'the recorded packets are not here: {FOLDER}')
    return (FOLDER / f'{name}.bin').read_bytes()
