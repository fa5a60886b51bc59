"""The call for an emergency stop, which the Clock and every actuator server accept.

    base.do(emergency.stop())

Each server that receives it stops its own actuators; only the Clock releases the stop (`library/clock.py`).
To stop a whole robot, and be sure that it has stopped, use `colony.runtime.kit.emergency`.
"""

from __future__ import annotations

from colony.ir.servers import DSERVER, RSERVER
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import EMERGENCY_STOP, NoArguments

ACTUATOR_SERVERS = (RSERVER.name, DSERVER.name)
"""Names of the servers with actuators that most robots have."""


def stop() -> CallRequest[None]:
    """Stop immediately, and stay stopped until a tick of the Clock carries a release.

    At the Clock, the stop survives restarts of every process, the Clock included. The Clock refuses with the
    code "not kept" if it stops the robot but cannot write the stop to its file.
    """
    return CallRequest(EMERGENCY_STOP, NoArguments(), type(None), "stop", repeatable=True)
