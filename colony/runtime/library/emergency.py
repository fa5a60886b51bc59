"""The emergency stop, as the Clock and every server of actuators take it.

    base.do(emergency.stop())

Whoever hears it stops; the Clock alone releases (`library/clock.py`). To stop a whole robot, and to know that
it is stopped, use `colony.runtime.kit.emergency`.
"""

from __future__ import annotations

from colony.runtime.calls import EMERGENCY_STOP, Nothing
from colony.runtime.fields import SERVERS
from colony.runtime.library.ask import Ask

ACTUATOR_SERVERS = tuple(s.name for s in SERVERS if s.commands or s.open_fields)
"""The servers that actuators can be bound to."""


def stop() -> Ask[None]:
    """Stop at once, and stay stopped until the Clock tells of a release.

    The Clock keeps the stop over its own death and over restarts of all other servers. It refuses with the
    code "not kept" where it is stopped, but could not write that to its file.
    """
    return Ask(EMERGENCY_STOP, Nothing(), type(None), "stop", repeatable=True)
