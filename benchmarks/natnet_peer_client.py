"""
Count the frames that a public NatNet client gets: run by the Python of its environment.

Prints ``ready`` when it is connected, and as JSON what it got once no frame came for 5 s.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time

QUIET = 5.0  # s
HERE = '127.0.0.1'


class Count:
    """Frames so far: their numbers or, where a client tells none, their attitudes."""

    def __init__(self) -> None:
        self.frames, self.different, self.last = 0, 0, None
        self.newest = time.monotonic() + 600.0  # before the first frame

    def __call__(self, mark: object) -> None:
        """Count a frame by what makes it differ from the one before."""
        self.frames += 1
        self.different += mark != self.last
        self.last, self.newest = mark, time.monotonic()

    def wait(self) -> None:
        """Print the counts and end the process when nothing comes any more."""
        while time.monotonic() - self.newest < QUIET:
            time.sleep(0.1)
        print(json.dumps({'frames': self.frames, 'different': self.different}), flush=True)
        os._exit(0)


def natnet(count: Count, port: int, multicast: bool) -> None:
    """Count with natnet 0.3.0."""
    from natnet import NatNetClient
    client = NatNetClient(HERE, HERE, command_port=port, data_port=port + 1,
                          use_multicast=multicast)
    client.on_data_frame_received_event.handlers.append(
        lambda frame: count((frame.prefix.frame_number, frame.rigid_bodies[0].id_num)))
    client.connect()
    client.run_async()
    print('ready', flush=True)
    count.wait()


def natnetclient(count: Count, port: int) -> None:
    """Count with NatNetClient 0.8.3, whose constructor waits for a frame."""
    from natnetclient import NatClient

    class Counting(NatClient):
        def get_data(self) -> None:
            super().get_data()
            count((self.iFrame, self.rigid_bodies['mambo'].position is None))

    threading.Thread(target=count.wait).start()
    print('ready', flush=True)
    # its read_rate is to be above that of the cameras
    Counting(HERE, data_port=port + 1, comm_port=port, read_rate=2000)
    threading.Event().wait()


def motioncapture(count: Count, port: int) -> None:
    """Count with motioncapture 1.1, which tells no number of a frame."""
    import motioncapture
    client = motioncapture.connect('optitrack', {
        'hostname': HERE, 'interface_ip': HERE, 'port_command': str(port)})
    threading.Thread(target=count.wait).start()
    print('ready', flush=True)
    while True:
        client.waitForNextFrame()
        turn = client.rigidBodies['mambo'].rotation  # a position would need NumPy
        count((turn.x, turn.y, turn.z, turn.w))


def main() -> None:
    """Count with the client that the command line names."""
    kind, port, count = sys.argv[1], int(sys.argv[2]), Count()
    if kind == 'natnetclient':
        natnetclient(count, port)
    elif kind == 'motioncapture':
        motioncapture(count, port)
    else:
        natnet(count, port, kind == 'natnet')


if __name__ == '__main__':
    main()
