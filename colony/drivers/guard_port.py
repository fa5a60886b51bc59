"""The port of a guard: opened again with increasing pauses when it is lost, written at the line's pace."""

from __future__ import annotations

import selectors
import time
from collections.abc import Callable

from colony.drivers.guard_outbox import Outbox
from colony.drivers.link import Link, open_link

RETRY_NS = (100_000_000, 2_000_000_000)
"""Pauses before a lost port is opened again: the first, which doubles, and the longest."""

STABLE_NS = 1_000_000_000
"""Time in ns after which a port that is lost is opened again without a pause."""


class GuardedPort:
    """A port and what waits for it. Mutable; of the guard's thread.

    Attributes:
        is_new: whether the port is open, and nothing was sent since it was opened.

    Args:
        name: what `open_link` opens.
        baud: the baud rate of a serial port; 0 leaves it as it is.
        selector: waits for the port's bytes.
        on_data: takes bytes that arrived.
        on_status: called when the port was opened (None), and when it cannot be opened or is lost (why).
    """

    def __init__(
        self,
        name: str,
        baud: int,
        selector: selectors.BaseSelector,
        on_data: Callable[[bytes], None],
        on_status: Callable[[str | None], None],
    ) -> None:
        self.name, self.baud = name, baud
        self.outbox = Outbox(baud)
        self._selector = selector
        self._on_data = on_data
        self._on_status = on_status
        self.is_new = False
        self._link: Link | None = None
        self._retry_ns, self._pause_ns, self._opened_ns = 0, RETRY_NS[0], 0

    @property
    def is_open(self) -> bool:
        """True while bytes can be sent."""
        return self._link is not None

    def is_sent(self, channel: int) -> bool | None:
        """Return True once a channel's newest stop or decision has left this computer; None without one."""
        if self._link is None:
            return None
        return self.outbox.is_sent(time.monotonic_ns(), channel, unsent=self._link.unsent())

    def due_ns(self) -> int | None:
        """Return when `do_what_is_due` has something to do."""
        return self._retry_ns if self._link is None else self.outbox.due_ns()

    def do_what_is_due(self) -> None:
        """Write what the line has room for, and open a port that is lost."""
        try:
            while self._link is not None and (packet := self.outbox.next(time.monotonic_ns())):
                self.is_new = False
                self.outbox.wrote(packet, self._link.write(packet), time.monotonic_ns())
        except OSError as problem:
            self._lose(f"{self.name} is lost: {problem.strerror or problem}")
        if self._link is None and time.monotonic_ns() >= self._retry_ns:
            self._open()

    def write_all(self, within_ns: int) -> None:
        """Write all that is due before `within_ns` have passed, and wait for it."""
        until_ns = time.monotonic_ns() + within_ns
        while self.is_open and (due_ns := self.outbox.due_ns()) is not None and due_ns < until_ns:
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            self.do_what_is_due()

    def close(self) -> None:
        """Release the port; what it is lost for is nobody's concern any more."""
        if self._link is not None:
            self._link.close()

    def _open(self) -> None:
        try:
            self._link = open_link(self.name, self.baud)
        except OSError as problem:
            self._lose(str(problem))
            return
        self.is_new, self._opened_ns = True, time.monotonic_ns()
        self._selector.register(self._link, selectors.EVENT_READ, self._read)
        self._pause_ns = RETRY_NS[0]
        self._on_status(None)

    def _read(self) -> None:
        try:
            data = self._link.read() if self._link is not None else b""
        except OSError as problem:
            self._lose(f"{self.name} is lost: {problem.strerror or problem}")
            return
        if data:
            self._on_data(data)

    def _lose(self, why: str) -> None:
        link, self._link, self.is_new = self._link, None, False
        if link is not None:
            self._selector.unregister(link)
            link.close()
        self.outbox.clear()
        if link is not None and time.monotonic_ns() - self._opened_ns >= STABLE_NS:
            self._retry_ns = 0  # whether it can be opened again says more than why it was lost
            return
        self._retry_ns = time.monotonic_ns() + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, RETRY_NS[1])
        self._on_status(why)
