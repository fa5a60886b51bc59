"""Topics of one robot: names to which nodes send messages, and to which others listen.

A transport that serves several robots prefixes them with `colony/<robot>/` (see `live/keys.py`).
"""

from __future__ import annotations

from collections.abc import Iterable

CLOCK = "Clock"
OBSERVER = "Observer"

TICKS = "Clock/ticks"
READY = "Clock/ready"
RESTARTS = "Clock/restarts"
ANSWERS = "Clock/answers"
"""Topic of answers to ticks by servers that are not in the Clock's own list."""
VERDICTS = "verdicts"


def frames(server: str) -> str:
    """Return the topic of a server's frames; for the Clock, of the ticks that it publishes again."""
    return f"{server}/frames"


def fetches(server: str) -> str:
    """Return the topic of requests to a server (or the Clock) to publish a frame again."""
    return f"{server}/fetches"


def requests(server: str) -> str:
    """Return the topic of clients' requests to a server."""
    return f"{server}/requests"


def announcements(server: str) -> str:
    """Return the topic on which modules in Python announce their answers to a data server."""
    return f"{server}/announcements"


def checkpoints(server: str) -> str:
    """Return the topic of clients' checkpoints, and of recalls, to a data server."""
    return f"{server}/checkpoints"


def recall_answers(server: str, client: str) -> str:
    """Return the topic of a data server's answer to the `Recall` of a client, given by address."""
    return f"{server}/recalled/{client}"


def activity(server: str, module: str) -> str:
    """Return the name under which a data server publishes the activity of a module in Python, as frames."""
    return f"{server}/activity/{module}"


def repeats(server: str, module: str) -> str:
    """Return the topic on which a data server asks a module in Python to announce an answer again."""
    return f"{server}/repeats/{module}"


def calls(server: str) -> str:
    """Return the topic of calls, signs of life and malformed calls to a server."""
    return f"{server}/call"


def replies(server: str, connection: str) -> str:
    """Return the topic of a server's replies and notices to a connection (`user/id`)."""
    return f"{server}/reply/{connection}"


def client_address(actuator: str, module: str) -> str:
    """Return the address of the client that `module` is for `actuator`."""
    return f"{actuator}/{module}"


def servers(addresses: Iterable[str]) -> tuple[str, ...]:
    """Return the addresses that are not of clients: those under which others look for a node."""
    return tuple(address for address in addresses if "/" not in address)


def module_of(address: str) -> str:
    """Return the module of a client's address."""
    return address.partition("/")[2]


def user_of(connection: str) -> str:
    """Return the user of a connection, `user/id`."""
    return connection.partition("/")[0]
