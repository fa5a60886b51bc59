"""A node that only listens: it hears a robot, and no part of the robot notices it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from colony.runtime.protocol.messages import Node
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import RobotAddress


@contextmanager
def hosting_listener(robot_address: RobotAddress, listener: Node) -> Iterator[None]:
    """Let a node that sends nothing hear a robot, in a thread of its own, as long as the context lasts.

    Raises:
        LiveError: the robot cannot be joined.
    """
    with ExitStack() as resources:
        host = resources.enter_context(Host.open(robot_address, (listener,), announces=False))
        thread = threading.Thread(target=host.run, name="listener", daemon=True)
        thread.start()
        resources.callback(thread.join)
        resources.callback(host.stop)
        yield
