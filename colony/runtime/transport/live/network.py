"""The session of zenoh that a process has with a robot; a server has a second one for emergency stops."""

from __future__ import annotations

import errno
import os
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import zenoh

from colony.runtime.transport.live import configuration, keys
from colony.runtime.transport.live.configuration import Settings
from colony.runtime.transport.live.errors import NotReached
from colony.runtime.transport.live.names import local_user as local_user
from colony.runtime.transport.live.place import Local, Place, Remote
from colony.runtime.transport.live.probe import why_not_reached

THREADS = "(rx: (worker_threads: 2), acc: (handover: rx), tx: (worker_threads: 1), net: (handover: tx))"
"""Threads of zenoh, as `ZENOH_RUNTIME` gives them, unless this is set already. Receiving and accepting share
theirs: if they had separate threads, each message would wake two, one that notices it and one that reads it.
Sending, and with it the signs of life, has a thread of its own: a server that is flooded with calls has to go
on telling the others that it lives, or they give up their links to it."""

LINKING_S = 0.1
"""After this time all sockets that are there have been tried."""

DESCRIPTORS = 32
"""Descriptors that must be free where a session is opened: it takes 12 at most, and one for each process
that it is linked with."""

Watcher = Callable[[str, bool], None]
"""Told of the address of a node, and whether it is there."""


class ZenohSession:
    """Mutable: open or closed. Use it in a `with`: until it is closed, the process does not end.

    No process forks while it has one open. `stops` is the second session of a server, for emergency stops
    from the gateway: on the link of the first session they would wait behind a flood of calls. It is None in
    processes that only connect, and in the gateway.
    """

    def __init__(
        self, place: Place, session: zenoh.Session, holds: ExitStack, stops: zenoh.Session | None = None
    ) -> None:
        self.place = place
        self.session = session
        self.stops = stops
        self._holds = holds
        self._opened = time.monotonic()
        self._present: dict[str, None] = {}
        self._watchers: tuple[Watcher, ...] = ()
        handler = zenoh.handlers.Callback(self._presence, indirect=False)
        tokens = session.liveliness()
        tokens.declare_subscriber(keys.alive(place.robot, "**"), handler, history=True)

    @classmethod
    def open(
        cls, place: Place, *, listens: tuple[str, ...] = (), settings: Settings | None = None
    ) -> ZenohSession:
        """Join the robot's processes, on this machine as the servers named by `listens`, which are then found
        under the socket of the first. `settings` take the place of the usual ones.

        Raises:
            AlreadyRunning: one of `listens` runs already.
            RunDirectoryError: the robot's folder cannot be used.
            NotReached: the gateway cannot be reached, or refuses.
        """
        with ExitStack() as holds:
            if isinstance(place, Local):
                place.directory.prepare()
                for name in listens:
                    holds.enter_context(place.directory.claim(name))
            stops = None
            if isinstance(place, Local) and listens and settings is None:
                stops = _open(place, configuration.stop_settings(place.directory), holds)
            if settings is None:
                settings = configuration.settings(place, listens=listens[:1])
            session = _open(place, settings, holds)
            return cls(place, session, holds.pop_all(), stops)

    @property
    def robot(self) -> str:
        return self.place.robot

    @property
    def user(self) -> str:
        """Who this process is to servers: the user of the certificate, else the one of this machine."""
        return self.place.credentials.user if isinstance(self.place, Remote) else local_user()

    def alive(self) -> tuple[str, ...]:
        """The addresses of the nodes that are there now, as far as one has heard."""
        time.sleep(max(0.0, self._opened + LINKING_S - time.monotonic()))
        return tuple(sorted(self._present))

    def watch(self, watcher: Watcher) -> None:
        """Tell `watcher` of every node that comes or goes from now on, in a thread of the network."""
        self._watchers = (*self._watchers, watcher)

    def unwatch(self, watcher: Watcher) -> None:
        """Tell it no more."""
        self._watchers = tuple(w for w in self._watchers if w != watcher)

    def _presence(self, sample: zenoh.Sample) -> None:
        address = str(sample.key_expr).removeprefix(keys.alive(self.robot, ""))
        present = sample.kind == zenoh.SampleKind.PUT
        if present:
            self._present[address] = None
        else:
            self._present.pop(address, None)
        for watcher in self._watchers:
            watcher(address, present)

    def close(self) -> None:
        """Leave; again is nothing."""
        self._holds.close()

    def __enter__(self) -> ZenohSession:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


def _open(place: Place, settings: Settings, holds: ExitStack) -> zenoh.Session:
    _expect_descriptors()
    try:
        with _threads():
            session = zenoh.open(configuration.configuration(settings))
    except zenoh.ZError as problem:
        raise NotReached(_why(place, settings, problem)) from None
    except BaseException as problem:
        if type(problem).__name__ != "PanicException":  # of Rust: no Exception, and nowhere to be imported
            raise
        raise NotReached(f"no session can be opened, for lack of memory or threads: {problem}") from None
    holds.callback(session.close)
    return session


@contextmanager
def _threads() -> Iterator[None]:
    """Let zenoh have `THREADS`. It reads the variable when the first session is opened; processes that this
    one starts do not inherit it."""
    if "ZENOH_RUNTIME" in os.environ:
        yield
        return
    os.environ["ZENOH_RUNTIME"] = THREADS
    try:
        yield
    finally:
        os.environ.pop("ZENOH_RUNTIME", None)


def _expect_descriptors() -> None:
    """Check that a session can have the files that it needs: zenoh would not say so, but panic.

    Raises:
        NotReached: it cannot.
    """
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if most == resource.RLIM_INFINITY:
        return
    try:
        used = len(os.listdir("/proc/self/fd"))
    except OSError as problem:  # this takes one, too; not every system has such a folder
        used = most if problem.errno == errno.EMFILE else 0
    if most - used < DESCRIPTORS:
        text = f"this process may have {most} files open, and has {used}; a session needs {DESCRIPTORS} more"
        raise NotReached(f"{text}: raise the limit (`ulimit -n`)")


def _why(place: Place, settings: Settings, problem: zenoh.ZError) -> str:
    match place:
        case Remote():
            return why_not_reached(place)
        case Local(directory=directory):
            return f"{directory.robot}: cannot listen at {settings['listen/endpoints']}: {problem}"


def local_time(place: Local) -> Callable[[], int]:
    """The robot's time on its own machine: nanoseconds of the monotonic clock since its base.

    Raises:
        RunDirectoryError: the robot's folder cannot be used.
    """
    base, monotonic = place.directory.base_ns(), time.monotonic_ns
    return lambda: monotonic() - base
