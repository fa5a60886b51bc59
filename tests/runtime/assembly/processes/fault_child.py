"""A client of a robot that a test may kill or freeze at any time; its argument says what it does.

`hold`: it takes the lock of the base and a semaphore, and waits behind others for another; says "holds".
`write`: it counts in a variable, and says each number once DServer has acknowledged it.
"""

from __future__ import annotations

import sys
import time
from itertools import count

from colony.runtime.kit.connection import Session
from colony.runtime.library import data, robot
from tests.cli.machine import ROBOT

HELD, QUEUE, COUNTER = "held", "queue", "counter"
PRIORITY = 80


def hold(session: Session) -> None:
    base = session.connect("RServer", name="victim", priority=PRIORITY)
    variables = session.connect("DServer", name="victim")
    base.do(robot.lock())
    variables.do(data.wait(HELD, hold=True))
    variables.send(data.wait(QUEUE))
    print("holds", flush=True)
    while True:
        time.sleep(60)


def write(session: Session) -> None:
    variables = session.connect("DServer", name="writer", timeout_s=30.0)
    for number in count(1):
        variables.do(data.set(COUNTER, number))
        print(number, flush=True)


if __name__ == "__main__":
    with Session.open(ROBOT) as opened:
        {"hold": hold, "write": write}[sys.argv[1]](opened)
