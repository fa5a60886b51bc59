"""Programs held to the bodies of their robots, when they are checked and before they are run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from colony.dsl.descriptions import body_note, find_body
from colony.ir.program import Program, Robot
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, has_errors

if TYPE_CHECKING:
    from colony.body.reader import BodyFile


class BodyCheck:
    """Holds programs to the bodies of their robots. Mutable: reads each body once, and notes a robot once."""

    def __init__(self) -> None:
        self._files: dict[Path, BodyFile] = {}
        self._noted: set[tuple[str, int]] = set()

    def findings(self, program: Program) -> tuple[Diagnostic, ...]:
        """Return what is wrong with the body of a program's robot, and what of the robot does not fit it.

        That of a robot without a body is one note.
        """
        path = find_body(program.robot)
        return self._without(program.robot) if path is None else self._held_to(path, program)

    def misfits(self, program: Program) -> tuple[Diagnostic, ...]:
        """Return the findings if there are errors among them, which keep a program from being run."""
        path = find_body(program.robot)
        found = () if path is None else self._held_to(path, program)
        return found if has_errors(found) else ()

    def _held_to(self, path: Path, program: Program) -> tuple[Diagnostic, ...]:
        if program.site is None and _is_shipped(path):
            return ()  # tests hold the robots that come with colony to their bodies
        from colony.body.disagreements import findings

        return findings(program.robot, self._file(path))

    def _file(self, path: Path) -> BodyFile:
        from colony.body.reader import read_body

        if path not in self._files:
            self._files[path] = read_body(path)
        return self._files[path]

    def _without(self, robot: Robot) -> tuple[Diagnostic, ...]:
        from colony.ir.servers import COMMON_SERVERS

        common = {server.name for server in COMMON_SERVERS}
        place = robot.span.source.name, robot.span.start
        named = {*(s.server for s in robot.sensors), *(a.server for a in robot.actuators)}
        if named <= common or place in self._noted:
            return ()
        self._noted.add(place)
        return (body_note(robot, _when_run(robot)),)


def _is_shipped(body: Path) -> bool:
    """Return True for the body of a robot that comes with colony."""
    interface = Path(os.path.abspath(body)).with_suffix(Shipped.ROBOT.suffix)
    return Shipped.ROBOT.contains(interface)


def _when_run(robot: Robot) -> str:
    """Return what a simulated run of a robot without a body does."""
    from colony.body.servers import servers_of
    from colony.body.shipped import ROME, shipped_body
    from colony.ir.fitting import misfits

    found = [misfit.message for misfit in misfits(robot, servers_of(shipped_body(ROME), robot))]
    start = f"`colony run --map` takes the body of `{ROME}`"
    if not found:
        return f"{start}, which fits"
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"{start}, which does not fit: {found[0]}{more}"
