"""A process's zenoh session with a robot; a server has a second session for emergency stops."""

from __future__ import annotations

import errno
import os
import resource
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from threading import Thread

import zenoh

from colony.runtime.transport.live import configuration, keys
from colony.runtime.transport.live.configuration import Settings, diagnose
from colony.runtime.transport.live.robot_address import Local, Remote, RobotAddress
from colony.runtime.transport.live.run_directory import ForkedError, UnreachableError
from colony.runtime.transport.live.run_directory import local_user as local_user

RECEIVING_THREADS = 2
"""Receiving threads of a process that is not a gateway."""


def threads(receiving: int = RECEIVING_THREADS) -> str:
    """Return the threads of zenoh, with so many for `receiving`, in the format of `ZENOH_RUNTIME`.

    Receiving and accepting share threads: with separate ones, each message would wake two, one that notices
    it and one that reads it. Sending, including keepalives, has its own thread: a server that is flooded with
    calls must keep sending keepalives, or the other processes close their links to it.
    """
    return (
        f"(rx: (worker_threads: {receiving}), acc: (handover: rx), tx: (worker_threads: 1), "
        "net: (handover: tx))"
    )


SOCKET_SCAN_S = 0.1
"""Seconds after which all existing sockets have been tried."""

FREE_DESCRIPTORS = 32
"""File descriptors that must be free to open a session, which needs up to 12, plus one per linked process."""

CLOSE_S = 0.5
"""Seconds that a session may take to close by itself."""

Watcher = Callable[[str, bool], None]
"""A function that takes the address of a node, and True if the node is present."""


class ZenohSession:
    """A process's session. Mutable.

    Use it in a `with`: an open session keeps the process alive. A process that is forked afterwards can use
    no session (`require_threads`), and closing one there does nothing.

    `stops` is the second session of a server, for emergency stops from the gateway: on the link of the first
    session, stops would wait behind a flood of calls. It is None in processes that only connect, and in the
    gateway.
    """

    def __init__(
        self,
        robot_address: RobotAddress,
        session: zenoh.Session,
        resources: ExitStack,
        stops: zenoh.Session | None = None,
    ) -> None:
        self.robot_address = robot_address
        self.session = session
        self.stops = stops
        self._resources = resources
        self._opened = time.monotonic()
        self._present: dict[str, None] = {}
        self._watchers: tuple[Watcher, ...] = ()
        handler = zenoh.handlers.Callback(self._presence, indirect=False)
        tokens = session.liveliness()
        tokens.declare_subscriber(keys.liveliness_key(robot_address.robot, "**"), handler, history=True)

    @classmethod
    def open(
        cls,
        robot_address: RobotAddress,
        *,
        server_names: tuple[str, ...] = (),
        settings: Settings | None = None,
        receiving_threads: int = RECEIVING_THREADS,
    ) -> ZenohSession:
        """Join the robot's processes, on this machine as the servers named by `server_names`.

        Other processes find these servers through the socket of the first. `settings` replace the default
        ones. The first session of a process decides how many `receiving_threads` it has.

        Raises:
            AlreadyRunningError: another process already serves one of `server_names`.
            ForkedError: this process was forked from one that had opened a session.
            RunDirectoryError: the robot's folder cannot be used.
            UnreachableError: the gateway cannot be reached, or refuses the login.
        """
        require_threads()
        with ExitStack() as resources:
            if isinstance(robot_address, Local):
                robot_address.directory.prepare()
                for name in server_names:
                    resources.enter_context(robot_address.directory.claim(name))
            stops = None
            if isinstance(robot_address, Local) and server_names and settings is None:
                stops = _open(
                    robot_address,
                    configuration.stop_settings(robot_address.directory),
                    resources,
                    receiving_threads,
                )
            if settings is None:
                settings = configuration.settings(robot_address, server=next(iter(server_names), None))
            session = _open(robot_address, settings, resources, receiving_threads)
            return cls(robot_address, session, resources.pop_all(), stops)

    def claim(self, names: Iterable[str]) -> None:
        """Serve under further names, as no other process of this machine can until this session is closed.

        Raises:
            AlreadyRunningError: another process already serves one of them.
            RunDirectoryError: the robot's folder cannot be used.
        """
        if isinstance(self.robot_address, Local):
            for name in names:
                self._resources.enter_context(self.robot_address.directory.claim(name))

    @property
    def robot(self) -> str:
        """The name of the robot."""
        return self.robot_address.robot

    @property
    def user(self) -> str:
        """The user that servers see: that of the certificate for a remote robot, else this process's."""
        return self.robot_address.credentials.user if isinstance(self.robot_address, Remote) else local_user()

    def alive(self) -> tuple[str, ...]:
        """Return the addresses of the nodes that are currently present.

        Raises:
            ForkedError: the session was opened before this process was forked.
        """
        require_threads()
        time.sleep(max(0.0, self._opened + SOCKET_SCAN_S - time.monotonic()))
        return tuple(sorted(self._present))

    def watch(self, watcher: Watcher) -> None:
        """Call `watcher` for every node that joins or leaves from now on, in a network thread."""
        self._watchers = (*self._watchers, watcher)

    def unwatch(self, watcher: Watcher) -> None:
        """Stop calling `watcher`."""
        self._watchers = tuple(w for w in self._watchers if w != watcher)

    def _presence(self, sample: zenoh.Sample) -> None:
        address = str(sample.key_expr).removeprefix(keys.liveliness_key(self.robot, ""))
        present = sample.kind == zenoh.SampleKind.PUT
        if present:
            self._present[address] = None
        else:
            self._present.pop(address, None)
        for watcher in self._watchers:
            watcher(address, present)

    def close(self) -> None:
        """Leave the network. Idempotent."""
        if not is_forked():
            self._resources.close()

    def __enter__(self) -> ZenohSession:
        """Return the session."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the session."""
        self.close()


class _Fork:
    """What a fork does to the threads of zenoh, which all sessions of a process share. Mutable."""

    threads_run = False
    threads_lost = False

    @classmethod
    def on_fork(cls) -> None:
        """Record, in the forked process, that it has no threads."""
        cls.threads_lost = cls.threads_run


os.register_at_fork(after_in_child=_Fork.on_fork)


def is_forked() -> bool:
    """Return True if this process was forked from one that had opened a session."""
    return _Fork.threads_lost


def require_threads() -> None:
    """Check that sessions work in this process; call it before anything that a fork may have left locked.

    Raises:
        ForkedError: it was forked from one that had opened a session: all calls would hang.
    """
    if is_forked():
        raise ForkedError(
            "connections do not work in a process that was forked after its parent had opened one: fork "
            'before, or use multiprocessing.get_context("spawn")'
        )


def _open(
    robot_address: RobotAddress, settings: Settings, resources: ExitStack, receiving_threads: int
) -> zenoh.Session:
    _check_descriptors()
    try:
        with _threads(receiving_threads):
            _Fork.threads_run = True
            session = zenoh.open(configuration.configuration(settings))
    except zenoh.ZError as problem:
        raise UnreachableError(_open_failure(robot_address, settings, problem)) from None
    except BaseException as problem:
        # Rust's panic is not an Exception and cannot be imported
        if type(problem).__name__ != "PanicException":
            raise
        raise UnreachableError(
            f"no session can be opened, for lack of memory or threads: {problem}"
        ) from None
    _open_sessions.append(session)
    resources.callback(_close, robot_address, session)
    return session


_open_sessions: list[zenoh.Session] = []
"""The sessions of this process that are not being closed."""


def _close(robot_address: RobotAddress, session: zenoh.Session) -> None:
    """Close a session, even if a frozen process of the robot does not answer a dial.

    Zenoh waits for its dials, which end when their sockets are shut down. Those of sessions that stay open
    are not known apart; so one that is not the last of the process is closed in the background.
    """
    _open_sessions.remove(session)

    def close() -> None:
        with suppress(zenoh.ZError):  # it took too long
            session.close()  # type: ignore[no-untyped-call]

    closing = Thread(target=close, name="closing", daemon=True)
    closing.start()
    closing.join(CLOSE_S)
    if _open_sessions:
        return
    if closing.is_alive() and isinstance(robot_address, Local):
        _shut_down_links(os.fsencode(robot_address.directory.path) + b"/")
    closing.join()


def _shut_down_links(folder: bytes) -> None:
    """Shut down all sockets of this process that are bound, or connected to one, in this folder."""
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError), socket.socket(fileno=os.dup(int(name))) as link:
            if link.family == socket.AF_UNIX and any(
                os.fsencode(address()).startswith(folder) for address in (link.getsockname, link.getpeername)
            ):
                link.shutdown(socket.SHUT_RDWR)


@contextmanager
def _threads(receiving: int) -> Iterator[None]:
    """Apply `threads` to zenoh, which reads the variable when the first session is opened.

    A variable that is already set takes precedence. Child processes do not inherit this one.
    """
    if "ZENOH_RUNTIME" in os.environ:
        yield
        return
    os.environ["ZENOH_RUNTIME"] = threads(receiving)
    try:
        yield
    finally:
        os.environ.pop("ZENOH_RUNTIME", None)


def _check_descriptors() -> None:
    """Check that a session can open the files it needs: zenoh would panic without a message.

    Raises:
        UnreachableError: too few descriptors are free.
    """
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if limit == resource.RLIM_INFINITY:
        return
    try:
        used = len(os.listdir("/proc/self/fd"))
    except OSError as problem:  # listing needs a descriptor, too, and not every system has this folder
        used = limit if problem.errno == errno.EMFILE else 0
    if limit - used < FREE_DESCRIPTORS:
        needed = f"a session needs {FREE_DESCRIPTORS} more: raise the limit (`ulimit -n`)"
        raise UnreachableError(f"this process may have {limit} files open, and has {used}; {needed}")


def _open_failure(robot_address: RobotAddress, settings: Settings, problem: zenoh.ZError) -> str:
    match robot_address:
        case Remote():
            return diagnose(robot_address)
        case Local(directory=directory):
            return f"{directory.robot}: cannot listen at {settings['listen/endpoints']}: {problem}"


def local_time(robot_address: Local) -> Callable[[], int]:
    """Return the robot's clock on its own machine: nanoseconds since the origin of the robot's time.

    Raises:
        RunDirectoryError: the robot's folder cannot be used.
    """
    origin_ns, monotonic = robot_address.directory.origin_ns(), time.monotonic_ns
    return lambda: monotonic() - origin_ns
