"""Which bodies of a server are those asked for, whether their poses come, and what to report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from mambo_model.errors import visible

from .client import Client

OK, WARN, ERROR = range(3)
AFTER = 3_000_000_000  # ns of stamps before the last one, by which a clock was set: the clocks may
# be matched wrongly for clock_match.PATIENCE frames, which take less from 67 Hz on
MISSING = 0.2  # [-] share of the frames that are missing, from which it is told
_MOST = 5  # bodies that are named for each reason
_LONGEST = 600  # characters of a report
_WHY = {
    'not tracked': 'it is not tracked', 'without a pose': 'its numbers are no pose',
    'that share their identifier': 'bodies of a frame share its identifier'}


class Watch:
    """
    Finds the bodies that were asked for, and refuses those that cannot be told apart.

    Parameters
    ----------
    wanted
        Name or streaming identifier of each body.
    server_time : bool
        Whether stamps are the server's timestamps.
    now : s
        Of a clock that is never set, as in all methods.

    Attributes
    ----------
    stamps : dict
        ns, of the last pose of each body; -1 before the first one.
    poses : Counter
        Published, of each body.

    """

    def __init__(self, wanted: Iterable[str], server_time: bool, now: float) -> None:
        self._wanted, self._server_time = tuple(wanted), server_time
        self.stamps = dict.fromkeys(self._wanted, -1)
        self.poses: Counter[str] = Counter()
        self._came = dict.fromkeys(self._wanted, now)
        self._before: dict[str, int] = {}  # ns, arrival of the first stamp that was too early
        self._back = 0  # ns, by which stamps went back since the last report
        self._counted: Counter[str] = Counter()  # at the last report
        self._posed: Counter[str] = Counter()
        self._servers = 0
        self._find(None)

    def follow(self, client: Client) -> None:
        """Look at the definitions and the clock again where they are others."""
        if client.defined is not self._defined:
            self._find(client.defined)
        if client.servers != self._servers:
            self._servers = client.servers
            if self._server_time:
                self.stamps = dict.fromkeys(self._wanted, -1)

    def _find(self, defined: tuple[tuple[int, str], ...] | None) -> None:
        """Find the identifiers; without definitions those that were asked for themselves."""
        self._defined = defined
        self._identifiers: dict[str, int] = {}
        self._ambiguous: dict[str, str] = {}
        for name in self._wanted:
            found = [one for one in defined or () if name in (one[1], str(one[0]))]
            alike = [one for one in defined or () if found and one[0] == found[0][0]]
            several = found if len(found) > 1 else alike
            if len(several) > 1:
                self._ambiguous[name] = ', '.join(
                    f'{other} ({identifier})' for identifier, other in several[:_MOST])
            elif found:
                self._identifiers[name] = found[0][0]
            elif name.isascii() and name.isdecimal():
                self._identifiers[name] = int(name)
        self._names: dict[int, list[str]] = {}
        for name, identifier in self._identifiers.items():
            self._names.setdefault(identifier, []).append(name)

    def names(self, identifier: int) -> list[str]:
        """Return which of the bodies that were asked for have an identifier."""
        return self._names.get(identifier, [])

    def accept(self, name: str, stamp: int, arrived: int, now: float) -> bool:
        """
        Return whether the pose of a body is to be published; count it.

        Stamps increase. If they stay before the last one for AFTER, a clock was set back.
        """
        last = self.stamps[name]
        if stamp <= last:
            since = self._before.setdefault(name, arrived)
            if stamp == last or abs(arrived - since) < AFTER:
                return False
            self._back = max(self._back, last - stamp)
        self._before.pop(name, None)
        self.stamps[name], self._came[name] = stamp, now
        self.poses[name] += 1
        return True

    def report(self, client: Client, where: str, obstacle: str, now: float) -> tuple[int, str]:
        """
        Return level and line of what was the case since the last report.

        Parameters
        ----------
        client
            Its counts tell what happened.
        where
            Address and port of the server.
        obstacle
            Why no frame can be received; empty: none.
        now : s
            As above.

        """
        counts = client.counts - self._counted
        posed = self.poses - self._posed
        self._counted, self._posed = client.counts.copy(), self.poses.copy()
        back, self._back = self._back, 0
        frames, malformed = counts['frames'], counts['malformed']
        if client.info is None:
            return ERROR, visible(
                f'the reply of {where} is of no use: {client.problem}' if malformed else
                f'no reply from {where}: is streaming switched on there?')
        if not frames:
            if malformed and not obstacle:
                obstacle = f'connected, but no frame is of use: {client.problem}'
            elif counts['late frames'] and not obstacle:
                obstacle = 'connected, but all frames are older than one that came before'
            return ERROR, visible(obstacle or 'connected, but no frame comes')
        lines = [f'malformed packets: {client.problem}'] if malformed else []
        if back:
            lines.append(f'stamps went back by {back * 1e-9:.1f} s: a clock was set')
        sent = frames + counts['missing frames']
        if counts['missing frames'] > MISSING * sent:
            lines.append(f'{counts["missing frames"]} of {sent} frames are missing')
        lines += self._missing([name for name in self._wanted if not posed[name]], client, now)
        if lines:
            return WARN, visible('; '.join(lines))[:_LONGEST]
        return OK, f'{frames} frames a second'

    def _missing(self, names: list[str], client: Client, now: float) -> list[str]:
        """Return why bodies have no pose."""
        lines = [f'{name} is refused, as several bodies have its name or identifier: {found}'
                 for name, found in [*self._ambiguous.items()][:_MOST]]
        here = client.defined or ()
        known = {*(name for _, name in here), *(str(identifier) for identifier, _ in here)}
        told = client.defined is not None
        unknown = [name for name in names
                   if name not in known and (told or name not in self._identifiers)]
        if unknown and not told:
            lines.append('the server has not answered which bodies it has: no pose of '
                         + _some(unknown))
        elif unknown:
            lines.append(f'the server does not stream {_some(unknown)}; it has: '
                         + (', '.join(name for _, name in here)[:200] or 'no rigid bodies'))
        silent = [name for name in names if name in self._identifiers and name not in unknown]
        for name in silent[:_MOST]:
            seconds = now - self._came[name]
            lines.append(f'no pose of {name} for {seconds:.1f} s: {self._why(name, client)}')
        return lines

    def _why(self, name: str, client: Client) -> str:
        """Return why a body that the server has is without poses."""
        reason = client.unusable.get(self._identifiers[name])
        if reason:
            return _WHY[reason]
        return 'its stamps are not after the last one' if name in self._before else (
            'it is not in the frames')


def _some(names: list[str]) -> str:
    """Return the first of some names, and how many there are beside them."""
    more = f' and {len(names) - _MOST} more' if len(names) > _MOST else ''
    return ', '.join(names[:_MOST]) + more
