"""The user interface of `colony run`: events go to standard error, and Ctrl-C ends the run."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from colony.cli.interruption import interruptible
from colony.cli.progress import RunProgress
from colony.cli.reporting import say
from colony.robots.request import UserInterface

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.runtime.kit.script import Script


def _operator(building: Building) -> Script:
    """Return a script that asks the user at the terminal to press elevator buttons."""
    from colony.cli.terminal import Terminal
    from colony.nav.missions.elevator_calls import elevator_prompt

    return elevator_prompt(building, Terminal(sys.__stdin__), say=say)


TERMINAL_INTERFACE = UserInterface(
    report=say, interruptible=interruptible, progress=RunProgress, operator=_operator
)
"""The interface at the terminal."""
