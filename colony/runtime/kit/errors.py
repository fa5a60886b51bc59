"""What can go wrong with a connection to a server; each message says what, where, and what to do."""

from __future__ import annotations


class ConnectionProblem(Exception):
    """Base of all: something about a connection or a call."""


class ServerNotFound(ConnectionProblem):
    """Nobody answers under the server's name."""


class CallRefused(ConnectionProblem):
    """The server does not do what it was asked.

    `code` is for programs: "arguments", "method", "right", "flood", "size", or one of the server's own.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class TimedOut(ConnectionProblem):
    """No answer came in time; whether the call was done is not known."""


class ConnectionLost(ConnectionProblem):
    """The connection ended before the answer came; whether the call was done is not known.

    The kit opens the connection anew by itself. What the old one held at the server (a lock, a place in a
    queue) is lost.
    """
