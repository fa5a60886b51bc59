"""Names, not addresses: the topics of one robot.

A transport that serves several robots puts `colony/<robot>/` before them (see `live/keys.py`).
"""

from __future__ import annotations

CLOCK = "Clock"
OBSERVER = "Observer"

TICKS = "Clock/ticks"
READY = "Clock/ready"
RESTARTS = "Clock/restarts"
ANSWERS = "Clock/answers"
"""Where servers that a Clock does not know by itself tell it that they answered a tick."""
VERDICTS = "verdicts"


def frames(server: str) -> str:
    """Where a server publishes its frames, and the Clock the ticks that it was asked for again."""
    return f"{server}/frames"


def fetches(server: str) -> str:
    """Where a server (or the Clock) is asked for a frame again."""
    return f"{server}/fetches"


def requests(server: str) -> str:
    """Where a server takes the requests of its clients."""
    return f"{server}/requests"


def announcements(server: str) -> str:
    """Where modules in Python tell a data server whether they are active."""
    return f"{server}/announcements"


def checkpoints(server: str) -> str:
    """Where a data server takes the checkpoints of clients, and is asked for them."""
    return f"{server}/checkpoints"


def recalled(server: str, client: str) -> str:
    """Where a data server answers the `Recall` of a client, given by address."""
    return f"{server}/recalled/{client}"


def activity(server: str, module: str) -> str:
    """The name under which a data server publishes the activity of a module in Python, as frames."""
    return f"{server}/activity/{module}"


def calls(server: str) -> str:
    """Where a server takes calls and signs of life, and is told of malformed ones."""
    return f"{server}/call"


def replies(server: str, connection: str) -> str:
    """Where a connection (`user/id`) gets the replies and notices of a server."""
    return f"{server}/reply/{connection}"


def client_address(actuator: str, module: str) -> str:
    """The address of the client that `module` is for `actuator`."""
    return f"{actuator}/{module}"


def module_of(address: str) -> str:
    """The module of a client's address."""
    return address.partition("/")[2]


def user_of(connection: str) -> str:
    """Return the user of a connection, `user/id`."""
    return connection.partition("/")[0]
