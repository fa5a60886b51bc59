"""A server of your own: a battery, which clients may charge and behaviors may read.

python examples/battery_server.py --robot ada
"""

from __future__ import annotations

import argparse
import signal
import time

import msgspec

from colony.runtime.kit.server import Reading, RefusedError, Server, field, method
from colony.runtime.protocol.connections import Caller


class Charge(msgspec.Struct):
    """`charge`: with how many percent a minute; negative is to drain it."""

    rate: float


class Battery:
    """Simulated. Mutable: how full it was when the rate was set last."""

    def __init__(self) -> None:
        self._rate, self._level, self._since = -1.0, 80.0, time.monotonic()

    def level(self) -> float:
        """How full it is, in percent."""
        minutes = (time.monotonic() - self._since) / 60.0
        return min(max(self._level + self._rate * minutes, 0.0), 100.0)

    def reading(self) -> Reading:
        """The level as it is now: a device that is asked more rarely would say how long ago that was."""
        return Reading(self.level(), age_ns=0)

    def charge(self, caller: Caller, given: Charge) -> float:
        """Set the rate; gives the level."""
        if abs(given.rate) > 3000.0:
            raise RefusedError("arguments", f"{given.rate:g} %/min would harm the battery; at most 3000")
        self._level, self._since = self.level(), time.monotonic()
        self._rate = given.rate
        return self._level


def main() -> None:
    """The entry of the program."""
    parser = argparse.ArgumentParser(description="A battery as a server.")
    parser.add_argument("--robot", required=True, help="the robot's name")
    battery = Battery()
    with Server.open("Battery", robot=parser.parse_args().robot) as server:
        signal.signal(signal.SIGINT, lambda *_: server.exitloop())
        signal.signal(signal.SIGTERM, lambda *_: server.exitloop())
        server.mainloop(
            [method("charge", Charge, battery.charge)],
            fields=[
                field("level", battery.reading, meaning="how full the battery is, in percent", has_age=True)
            ],
        )


if __name__ == "__main__":
    main()
