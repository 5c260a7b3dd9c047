"""Quantiles of any number of delays in constant memory."""

from __future__ import annotations

_BIN = 1e-5  # s
_BINS = 10_000  # up to 0.1 s


class Delays:
    """
    Histogram of delays.

    Attributes
    ----------
    count : int
        Number of delays.
    longest : s
        The longest of them.

    """

    def __init__(self) -> None:
        self.count, self.longest = 0, 0.0
        self._bins = [0] * (_BINS + 1)

    def add(self, seconds: float) -> None:
        """Add one delay in s, not negative."""
        self.count += 1
        self.longest = max(self.longest, seconds)
        self._bins[min(int(seconds / _BIN), _BINS)] += 1

    def quantile(self, share: float) -> float:
        """
        Return the quantile of the delays in s, rounded up to 10 us.

        NaN where there was none.
        """
        if not self.count:
            return float('nan')
        seen = 0
        for k, many in enumerate(self._bins[:_BINS]):
            seen += many
            if seen >= share * self.count:
                return min((k + 1) * _BIN, self.longest)
        return self.longest

    def values(self) -> dict[str, str]:
        """Return median, 99th percentile and maximum in ms as texts by name."""
        times = {'p50': self.quantile(0.5), 'p99': self.quantile(0.99), 'max': self.longest}
        return {name: f'{1e3 * time:.2f}' for name, time in times.items()}
