"""What can go wrong between the processes of a robot that a person can mend; the message says how."""

from __future__ import annotations


class LiveError(Exception):
    """Something about the network of processes; the message is for people."""


class RunDirectoryError(LiveError):
    """The run directory cannot be used: not ours, open to others, or too long a path."""


class AlreadyRunning(LiveError):
    """A process of this name serves the robot already."""


class NotReached(LiveError):
    """A gateway cannot be reached, or refuses the login."""


class GatewayFull(LiveError):
    """The gateway's memory has reached its limit: its process has to restart, which ends its sessions."""


class SecurityError(LiveError):
    """Certificates or the table of users are not as they must be."""
