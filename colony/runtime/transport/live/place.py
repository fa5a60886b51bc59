"""Where a robot is, as a process sees it: on this machine, or behind a gateway on another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from colony.runtime.transport.live.run_directory import RobotDirectory, RunDirectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Credentials:
    """Who somebody is to a gateway: the certificate of `user` and its private key (PEM files), and the
    authority that signed the gateway's certificate."""

    user: str
    certificate: Path
    key: Path
    authority: Path


@dataclass(frozen=True, slots=True)
class Local:
    """A robot of this machine, by its folder."""

    directory: RobotDirectory

    @property
    def robot(self) -> str:
        return self.directory.robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Remote:
    """A robot behind a gateway at `endpoint` (`tls/HOST:PORT`)."""

    robot: str
    endpoint: str
    credentials: Credentials


Place = Local | Remote


def local(robot: str, environment: Mapping[str, str]) -> Local:
    """A robot of this machine.

    Raises:
        RunDirectoryError: no robot can have this name.
    """
    return Local(RunDirectory.find(environment).robot(robot))
