"""Messages that arrive before the first ``/clock``, when nobody knows the time of a flight."""

from __future__ import annotations

from collections.abc import Callable

_MOST = 2000  # messages
_LARGEST = 1 << 24  # bytes


class EarlyMessages:
    """Messages that are held back, in the order of their arrival."""

    def __init__(self) -> None:
        self._held: list[tuple[str, Callable[[bytes], None], bytes]] = []
        self._size = 0  # bytes

    def __len__(self) -> int:
        return len(self._held)

    def hold(self, topic: str, record: Callable[[bytes], None], data: bytes) -> bool:
        """Hold a message until :meth:`release` records it; return whether no more can be held."""
        self._held.append((topic, record, bytes(data)))
        self._size += len(data)
        return len(self._held) >= _MOST or self._size > _LARGEST

    def release(self) -> None:
        """Record every message that is held."""
        held, self._held = self._held, []
        for _, record, data in held:
            record(data)

    def forget(self, topic: str) -> int:
        """Drop the messages of a topic; return how many there were."""
        before = len(self._held)
        self._held = [one for one in self._held if one[0] != topic]
        return before - len(self._held)
