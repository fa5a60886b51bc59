"""Addresses of robots: a directory on this machine, or a gateway on another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from colony.runtime.transport.live.run_directory import RobotDirectory, RunDirectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Credentials:
    """The identity that a client presents to a gateway.

    All files are PEM: the certificate of `user`, its private key, and the certificate of the authority that
    signed the gateway's certificate.
    """

    user: str
    certificate: Path
    key: Path
    authority: Path


@dataclass(frozen=True, slots=True)
class Local:
    """A robot on this machine, identified by its directory."""

    directory: RobotDirectory

    @property
    def robot(self) -> str:
        """The name of the robot."""
        return self.directory.robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Remote:
    """A robot behind a gateway at `endpoint` (`tls/HOST:PORT`)."""

    robot: str
    endpoint: str
    credentials: Credentials


RobotAddress = Local | Remote


def local(robot: str, environment: Mapping[str, str]) -> Local:
    """Return the address of a robot on this machine.

    Raises:
        RunDirectoryError: the name is not valid for a robot.
    """
    return Local(RunDirectory.find(environment).robot(robot))
