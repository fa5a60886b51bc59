"""The user interface of `colony run`: the terminal, and the page of `--watch`, as long as the run lasts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from colony.cli.run.options import Options
    from colony.execute.compiled import Compiled
    from colony.robots.request import UserInterface


@contextmanager
def user_interface(compiled: Compiled, options: Options) -> Iterator[UserInterface]:
    """Lend the interface that the options choose to a run.

    Raises:
        DiagnosticError: the program cannot be rebuilt for the page from its source files, or the map is
            invalid.
    """
    from colony.cli.run.user_interface import TERMINAL_INTERFACE

    interface = TERMINAL_INTERFACE
    if options.shadow:
        from colony.cli.run.shadow_interface import shadow_interface

        interface = shadow_interface(compiled.robot.actuators)
    if not options.watch:
        yield interface
        return
    from colony.cli.run.page import shown_in_browser

    with shown_in_browser(compiled, options.map_path, options.robot) as sink:
        yield replace(interface, sinks=(sink,))
