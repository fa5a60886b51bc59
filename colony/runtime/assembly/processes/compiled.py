"""The compiled program as a file, from the process that compiled it to those that it starts.

It is a pickle, so that these need no parser and no compiler. Reading a pickle runs what its writer wrote:
it is read only from a file of this user's that nobody else can write to, and never comes over a network.
"""

from __future__ import annotations

import os
import pickle
import stat
from pathlib import Path
from typing import NamedTuple

from colony.compile.clients import ClientList
from colony.files import open_regular
from colony.ir.program import Program
from colony.os_errors import naming
from colony.runtime.protocol.bindings import Bindings, bind
from colony.runtime.protocol.fields import SERVERS, ServerSpec


class Compiled(NamedTuple):
    """A program, the clients that it compiles to, and the servers that it reads besides those that every
    robot has."""

    program: Program
    clients: ClientList
    servers: tuple[ServerSpec, ...] = ()

    def bindings(self) -> Bindings:
        """Where the program's sensors and actuators are.

        Raises:
            Failure: something does not fit.
        """
        return bind(self.program, (*SERVERS, *self.servers))


class NotOurs(Exception):
    """The file could have been written by somebody else."""


def write_compiled(path: Path, compiled: Compiled) -> None:
    """Write it, whole or not at all, for this user alone.

    Raises:
        OSError: it cannot be written.
    """
    beside = path.with_suffix(f".{os.getpid()}")
    beside.unlink(missing_ok=True)
    with naming(beside), open(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        pickle.dump(tuple(compiled), file, protocol=pickle.HIGHEST_PROTOCOL)
    beside.replace(path)


def read_compiled(path: Path) -> Compiled:
    """Read it.

    Raises:
        NotOurs: it is another user's, or others may write to it.
        OSError: it cannot be read.
    """
    with open_regular(path) as file:
        found = os.fstat(file.fileno())
        if found.st_uid != os.getuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise NotOurs(f"{path}: it is not this user's alone, and is not read")
        return Compiled(*pickle.load(file))
