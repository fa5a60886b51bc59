"""Errors of connections to servers."""

from __future__ import annotations


class RobotConnectionError(Exception):
    """The base class of all errors of a connection or a call."""


class ServerNotFoundError(RobotConnectionError):
    """No server answers under the name."""


class CallRefusedError(RobotConnectionError):
    """The server refuses the call.

    `code` is for programs: "arguments", "method", "right", "flood", "size", or a code of the server's own.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class CallTimeoutError(RobotConnectionError):
    """No answer came in time; the call may or may not have been executed."""


class ConnectionLostError(RobotConnectionError):
    """The connection ended before the answer came; the call may or may not have been executed.

    The kit reopens the connection automatically. Its state at the server (a lock, a place in a queue) is
    lost.
    """
