"""The folder in which the processes of one machine's robots find each other, one subfolder per robot.

    <run directory>/<robot>/RServer.sock     the socket on which RServer listens
    <run directory>/<robot>/RServer.claim    locked by the process that runs RServer; contains its process id
    <run directory>/<robot>/3.slot           a link to the socket of the server that has this slot
    <run directory>/<robot>/base             the origin of the robot's time
    <run directory>/ttyUSB0-<hash>.guard     the socket of the guard of a port (`colony.drivers.guard`)

A process that can open the sockets has full control of the robot, so only its owner may enter the folder.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import pwd
import re
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from colony.files import (
    NO_ROOM,
    ClaimedError,
    FileClaim,
    UnsuitableFileError,
    claim_holder,
    limit_advice,
    naming,
    read_file,
    reason,
)

# --- names ---------------------------------------------------------------------------------------------
#
# Valid names of robots, servers, users and connections: a name is part of keys and of file names.


MAX_NAME_LENGTH = 64

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)
_USER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]*", re.ASCII)


def check_name(kind: str, name: str) -> str:
    """Return `name` if it is a valid name of a `kind` ("robot", "server").

    Raises:
        ValueError: the name is invalid.
    """
    return _check(kind, name, _NAME, "letters, digits, `_`, `-` and `.`")


def check_user(name: str) -> str:
    """Return `name` if it is a valid user name; a certificate's common name often contains an `@`.

    Raises:
        ValueError: the name is invalid.
    """
    return _check("user", name, _USER, "letters, digits, `_`, `-`, `.` and `@`")


def _check(kind: str, name: str, pattern: re.Pattern[str], expected: str) -> str:
    if len(name) > MAX_NAME_LENGTH or pattern.fullmatch(name) is None:
        raise ValueError(
            f"`{name}` cannot be the name of a {kind}: expected 1 to {MAX_NAME_LENGTH} characters, "
            f"{expected}, beginning with a letter or digit"
        )
    return name


def local_user() -> str:
    """Return the name of this process's user, or `uid<number>` if that is not a valid user name."""
    number = os.getuid()
    try:
        return check_user(pwd.getpwuid(number).pw_name)
    except (KeyError, ValueError):
        return f"uid{number}"


# --- errors --------------------------------------------------------------------------------------------
#
# Errors between a robot's processes that a user can fix; each message says how.


class LiveError(Exception):
    """An error in the network of processes; the message is for users."""


class RunDirectoryError(LiveError):
    """The run directory cannot be used: another user owns it, others can open it, or its path is too long."""


class AlreadyRunningError(LiveError):
    """Another process already serves the robot under this name."""


class UnreachableError(LiveError):
    """A gateway cannot be reached, or refuses the login."""


class ForkedError(LiveError):
    """This process was forked from one that had opened a session, so it can neither use nor open any."""


class GatewayFullError(LiveError):
    """The gateway's memory has reached its limit; its process must restart, which ends its sessions."""


class SecurityError(LiveError):
    """The certificates or the table of users are invalid."""


# --- run directory -------------------------------------------------------------------------------------


ADVICE = "set COLONY_RUN_DIR to a folder of yours"

MAX_SOCKET_PATH_BYTES = 107
"""Maximum length of the path of a unix socket in bytes (`sun_path` without its terminator)."""

FORBIDDEN_CHARACTERS = "#?"
"""Characters that end the address in a zenoh endpoint, and so cannot be in a socket's path."""

BASE_BYTES = 4096
"""Size limit in bytes of the file `base`."""

SLOTS = 32
"""Maximum number of servers whose names not every robot has, such as devices and servers of users."""

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """The folder of all robots of this user on this machine."""

    path: Path

    @classmethod
    def find(cls, environment: Mapping[str, str]) -> RunDirectory:
        """Return the run directory, which need not exist.

        It is `$COLONY_RUN_DIR`, else `$XDG_RUNTIME_DIR/colony`, else `/tmp/colony-<uid>`.
        """
        if chosen := environment.get("COLONY_RUN_DIR"):
            return cls(Path(chosen).absolute())
        if runtime := environment.get("XDG_RUNTIME_DIR"):
            return cls(Path(runtime).absolute() / "colony")
        return cls(Path(f"/tmp/colony-{os.getuid()}"))

    def robot(self, name: str) -> RobotDirectory:
        """Return the folder of a robot; it need not exist.

        Raises:
            RunDirectoryError: the name is not valid for a robot.
        """
        try:
            return RobotDirectory(self.path / check_name("robot", name), name)
        except ValueError as problem:
            raise RunDirectoryError(str(problem)) from None

    def guard(self, port: str) -> Path:
        """Return the path of the socket of a serial port's guard, in a folder that this user alone can enter.

        Raises:
            RunDirectoryError: the folder is another user's or open to others, or its path is too long.
        """
        _make_private(self.path)
        word = "".join(c for c in port.rpartition("/")[2] if c.isascii() and c.isalnum())[-20:]
        path = self.path / f"{word}-{hashlib.sha256(port.encode()).hexdigest()[:8]}.guard"
        size = len(os.fsencode(path))
        if size > MAX_SOCKET_PATH_BYTES:
            raise RunDirectoryError(_too_long(path, size))
        return path

    def robots(self) -> tuple[str, ...]:
        """Return the robots that have a folder, whether or not one of their servers runs.

        Raises:
            RunDirectoryError: another user owns the run directory, or it is open to others.
        """
        if not os.path.lexists(self.path):
            return ()
        _check_private(self.path)
        return tuple(sorted(p.name for p in self.path.iterdir() if p.is_dir()))


@dataclass(frozen=True, slots=True)
class RobotDirectory:
    """The folder of one robot."""

    path: Path
    robot: str

    def prepare(self) -> None:
        """Create the folder if it is missing, and ensure that only the owner can enter it.

        Raises:
            RunDirectoryError: another user owns it, it is open to others, or it cannot be created.
        """
        for folder in (self.path.parent, self.path):
            _make_private(folder)

    def socket(self, server: str) -> Path:
        """Return the path of a server's socket.

        Raises:
            RunDirectoryError: the path is too long or not valid for zenoh, or the server's name is invalid.
        """
        try:
            path = self.path / f"{check_name('server', server)}.sock"
        except ValueError as problem:
            raise RunDirectoryError(str(problem)) from None
        if not _is_utf8(path):
            raise RunDirectoryError(f"the path of a socket must be UTF-8, and {path} is not: {ADVICE}")
        if forbidden := [c for c in FORBIDDEN_CHARACTERS if c in str(path)]:
            raise RunDirectoryError(
                f"{path} cannot be the path of a socket, because it contains `{forbidden[0]}`: "
                "set COLONY_RUN_DIR to a folder without it"
            )
        size = len(os.fsencode(path))
        if size > MAX_SOCKET_PATH_BYTES:
            raise RunDirectoryError(_too_long(path, size))
        return path

    def endpoint(self, server: str) -> str:
        """Return the zenoh endpoint of a server's socket."""
        return f"unixsock-stream/{self.socket(server)}"

    def slot_endpoints(self) -> tuple[str, ...]:
        """Return the zenoh endpoints of all slots, in order."""
        return tuple(f"unixsock-stream/{self._slot(number)}" for number in range(SLOTS))

    def take_slot(self, server: str) -> int:
        """Take a slot for `server`, which this process has claimed, and return its number.

        A server keeps its slot over restarts until another server takes it.

        Raises:
            RunDirectoryError: running servers have all slots, or the folder cannot be used.
        """
        with in_run_directory(self.path), _locked(self.path):
            links = [self._slot(number) for number in range(SLOTS)]
            holders = [link.readlink().stem if link.is_symlink() else None for link in links]
            if server in holders:
                return holders.index(server)
            for number, holder in enumerate(holders):
                if holder is None or claim_holder(self.path / f"{holder}.claim") is None:
                    links[number].unlink(missing_ok=True)
                    links[number].symlink_to(self.socket(server).name)
                    return number
        raise RunDirectoryError(
            f"{self.robot} has {SLOTS} servers besides the standard ones: {server} is too many"
        )

    def _slot(self, number: int) -> Path:
        return self.path / f"{number}.slot"

    def servers(self) -> tuple[str, ...]:
        """Return the servers that have a socket here, including servers that were killed."""
        return tuple(sorted(p.stem for p in self.path.glob("*.sock")))

    def running(self) -> Mapping[str, int]:
        """Return the running servers with their process ids."""
        pids = {p.stem: claim_holder(p) for p in sorted(self.path.glob("*.claim"))}
        return {name: pid for name, pid in pids.items() if pid is not None}

    def claim(self, server: str) -> FileClaim:
        """Claim to be the only process that serves `server`, until the claim is closed or the process ends.

        Raises:
            AlreadyRunningError: another process serves it.
            RunDirectoryError: the folder cannot be used.
        """
        self.prepare()
        path = self.socket(server).with_suffix(".claim")
        with in_run_directory(path), ExitStack() as resources:
            try:
                claim = resources.enter_context(FileClaim(path))
            except ClaimedError as holder:
                raise AlreadyRunningError(
                    f"{server} of {self.robot} is already running, as process {holder}: "
                    "end it first, or give another --robot"
                ) from None
            claim.sign()
            resources.pop_all()
        return claim

    def origin_ns(self, *, monotonic: Callable[[], int] = time.monotonic_ns) -> int:
        """Return the time on the monotonic clock at which the robot's time is 0.

        The first process that calls this sets it. An origin from before a reboot is replaced, so that the
        robot's time has advanced by as much as the wall clock.

        Raises:
            RunDirectoryError: the folder cannot be used, or its file `base` cannot be read.
        """
        self.prepare()
        with in_run_directory(self.path), _locked(self.path):
            path, boot = self.path / "base", _boot_id()
            saved = _read_origin(path)
            if saved is not None and saved.boot == boot:
                return saved.origin_ns
            elapsed_ns = 0 if saved is None else max(0, time.time_ns() - saved.wall_ns)
            new = _SavedOrigin(
                boot=boot, origin_ns=monotonic() - elapsed_ns, wall_ns=time.time_ns() - elapsed_ns
            )
            temporary = path.with_suffix(".new")
            with naming(path):
                temporary.write_bytes(msgspec.json.encode(new))
            temporary.replace(path)
            return new.origin_ns


class _SavedOrigin(msgspec.Struct, frozen=True, kw_only=True):
    """The file `base`: the origin on the monotonic clock of one boot, and on the wall clock."""

    boot: str
    origin_ns: int = msgspec.field(name="base_ns")
    wall_ns: int


@contextmanager
def in_run_directory(path: Path) -> Iterator[None]:
    """Turn an OSError into an error with advice; `path` is named if the OSError names no file.

    Raises:
        RunDirectoryError: in place of any OSError, except when no more files can be opened.
    """
    try:
        yield
    except OSError as problem:
        if problem.errno in (errno.EMFILE, errno.ENFILE):
            raise
        default = f"free some space or {ADVICE}" if problem.errno in NO_ROOM else ADVICE
        advice = limit_advice(problem) or default
        raise RunDirectoryError(f"{problem.filename or path}: {problem.strerror}: {advice}") from None


def _make_private(folder: Path) -> None:
    with in_run_directory(folder):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check_private(folder)


def _check_private(folder: Path) -> None:
    with in_run_directory(folder):
        status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode):
        raise RunDirectoryError(f"{folder} is not a folder: {ADVICE}")
    if status.st_uid != os.getuid():
        raise RunDirectoryError(
            f"{folder} belongs to user {status.st_uid}, and this is user {os.getuid()}: {ADVICE}"
        )
    if status.st_mode & 0o077:
        raise RunDirectoryError(
            f"{folder} is open to others (mode {stat.S_IMODE(status.st_mode):04o}), who could drive the "
            f"robot: `chmod 700 {folder}`"
        )


def _too_long(path: Path, size: int) -> str:
    return (
        f"{path} is {size} bytes long, and the path of a socket can have {MAX_SOCKET_PATH_BYTES}: "
        "set COLONY_RUN_DIR to a shorter folder"
    )


def _is_utf8(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _boot_id() -> str:
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return "unknown"


def _read_origin(path: Path) -> _SavedOrigin | None:
    try:
        return msgspec.json.decode(read_file(path, BASE_BYTES), type=_SavedOrigin)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnsuitableFileError) as problem:
        raise RunDirectoryError(
            f"{path}: {reason(problem)}: remove it while no process of the robot is running"
        ) from None


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
