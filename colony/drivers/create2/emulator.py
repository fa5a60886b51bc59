"""An emulated Create 2 on a pseudoterminal, with the pace of its serial line.

    python -m colony.drivers.create2.emulator --room 3000x4000 --link /tmp/create2
    colony serve all --robot create2 --port /tmp/create2

It prints its port, and runs until it is interrupted; SIGUSR1 pulls out its cable, SIGUSR2 plugs it in.
"""

from __future__ import annotations

from colony.drivers.create2.create2 import Create2
from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.emulator import Emulator, emulator_options, run_emulator


def main() -> None:
    """Run an emulator from the command line."""
    prog = "python -m colony.drivers.create2.emulator"
    options = emulator_options(
        prog, "Emulate a Create 2 on a pseudoterminal.", baud=Create2.baud
    ).parse_args()
    robot = Create2Firmware(EmulatedWorld(range=options.room))
    run_emulator(Emulator(robot, baud=options.baud, link=options.link))


if __name__ == "__main__":
    main()
