"""An emulated Pioneer on a pseudoterminal, with the pace of a serial line.

    python -m colony.drivers.pioneer.emulator --room 4000x6000 --link /tmp/pioneer
    colony serve all --robot pioneer --port /tmp/pioneer

It prints its port, and runs until it is interrupted; SIGUSR1 pulls out its cable, SIGUSR2 plugs it in.
"""

from __future__ import annotations

from colony.drivers.emulator import Emulator, emulator_options, run_emulator
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import BAUD


def main() -> None:
    """Run an emulator from the command line."""
    prog = "python -m colony.drivers.pioneer.emulator"
    parser = emulator_options(prog, "Emulate a Pioneer on a pseudoterminal.", baud=BAUD)
    parser.add_argument(
        "--model",
        choices=sorted(MODELS),
        default="p3dx-sh",
        metavar="MODEL",
        help="the model: the name that the robot gives of itself (default: p3dx-sh)",
    )
    options = parser.parse_args()
    robot = PioneerFirmware(MODELS[options.model], around=options.room)
    run_emulator(Emulator(robot, baud=options.baud, link=options.link))


if __name__ == "__main__":
    main()
