"""`colony shadow`: run a behavior in the shadow of a robot, live or from a bag, which it does not command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.reporting import say
from colony.cli.robot_options import connect_option, security_option
from colony.cli.run.options import (
    behavior_argument,
    duration_option,
    format_option,
    record_option,
    robot_option,
    seed_option,
    site_option,
    unproved_option,
    watch_option,
)
from colony.extras import expect_extras
from colony.ir.program import Actuator
from colony.runtime.observe.comparison import command_text, heard_text

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.runs.spec import RunSpec, UserInterface
    from colony.runtime.frames.run_frame import RunFrame
    from colony.runtime.protocol.messages import Verdict

REPEAT_NS = 1_000_000_000
"""Nanoseconds after which a line is repeated although the winner has not changed."""


@click.command(name="shadow", short_help="show what a behavior would do on a robot that is served")
@behavior_argument
@robot_option
@connect_option()
@security_option()
@seed_option
@duration_option("until Ctrl-C")
@record_option
@site_option
@unproved_option
@click.option(
    "--bag",
    type=click.Path(path_type=Path),
    metavar="BAG",
    help="Read a bag of rosbag2 in place of a robot that is served: a folder, or a file of one.",
)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0.0, max=100.0),
    metavar="PERCENT",
    help="Commands count as the same that differ by this much of the range of each field. [default: 1]",
)
@format_option
@watch_option
def command(bag: Path | None, tolerance: float | None, watch: bool, **options: Any) -> None:
    """Run a behavior in the shadow of a robot that is already running, also beside a driver.

    FILE is a behavior, the name of one that comes with colony, or a compiled program (`colony compile -o
    NAME.colonyc`). It reads what the robot measures, sends nothing, and prints what it would have sent each
    second and whenever another client wins. A recording is marked as that of a shadow. It is the first thing
    to do with a new behavior on a real robot (docs/your-robot.md).

    If another controller drives the robot, the summary compares the two and says which contracts the
    controller broke. That is so with --bag, and for a robot that is served with --read-only (docs/ros2.md).

    Params, summary and exit code are as for `colony run`.

    \b
    Example:
      colony shadow wander --robot rome --record shadow.mcap
      colony shadow wander --robot rome --connect tls/rome.lab:7447 --security ada.toml
      colony shadow patrol.colony --robot burger --bag hall --record shadow.mcap
    """
    from colony.runtime.observe.comparison import DEFAULT_TOLERANCE

    tolerance = DEFAULT_TOLERANCE if tolerance is None else tolerance
    if bag is not None:
        from colony.cli.run.bag_run import run_with_bag

        options["watch"] = watch or None
        given = [name for name in ("connect", "security", "watch") if options.pop(name) is not None]
        if given:
            raise click.UsageError(f"--{given[0]} is for a robot that is served, not for a bag")
        record, kept = options.get("record"), Path(bag).resolve()
        if record is not None and kept in (written := Path(record).resolve(), *written.parents):
            raise click.UsageError(f"--record {record} would write into the bag, which is never changed")
        run_with_bag(bag, tolerance, options)
        return
    from colony.cli.run.running import run_on_served
    from colony.cli.run.shadow_run import run_shadow

    if watch:
        expect_extras("watch")
    run_on_served(partial(run_shadow, tolerance=tolerance), partial(_interface, watch=watch), options)


@contextmanager
def _interface(compiled: Compiled, spec: RunSpec, *, watch: bool) -> Iterator[UserInterface]:
    """Lend the interface at the terminal, which shows the decisions instead of a progress bar."""
    from colony.cli.run.interface import user_interface

    with user_interface(compiled, spec, watch=watch) as ui:
        yield replace(ui, progress=lambda length_ns: Decisions(compiled.robot.actuators, say))


class Decisions:
    """A sink that reports what would be sent when the winner changes, and once a second. Mutable.

    Args:
        actuators: the actuators of the program.
        report: callback for a line.
    """

    def __init__(self, actuators: tuple[Actuator, ...], report: Callable[[str], None]) -> None:
        self._actuators = actuators
        self._report = report
        self._winners: dict[str, str | None] = {}
        self._reported_ns: int | None = None

    def take(self, log: RunFrame) -> None:
        """Report a frame, if it is time to."""
        t_ns, reported_ns = log.tick.t_ns, self._reported_ns
        winners = {name: verdict.by for name, verdict in log.verdicts.items()}
        if winners == self._winners and reported_ns is not None and t_ns - reported_ns < REPEAT_NS:
            return
        self._winners, self._reported_ns = winners, t_ns
        parts = [_would_send(a, log.verdicts[a.name]) for a in self._actuators if a.name in log.verdicts]
        parts += [heard_text(a, log.heard[a.name]) for a in self._actuators if a.name in log.heard]
        self._report(f"{t_ns / 1e9:8.2f} s  would send {'; '.join(parts)}")

    def close(self) -> None:
        """Do nothing: every line has been reported."""


def _would_send(actuator: Actuator, verdict: Verdict) -> str:
    fault = f" ({verdict.fault})" if verdict.fault else ""
    if verdict.values is None:
        return f"nothing to {actuator.name}{fault}"
    return f"{command_text(actuator, verdict.values)} by {verdict.by or 'nobody'}{fault}"
