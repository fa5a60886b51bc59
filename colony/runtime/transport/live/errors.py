"""Errors between a robot's processes that a user can fix; each message says how."""

from __future__ import annotations


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
