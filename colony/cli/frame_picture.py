"""Pictures of one frame: the options of the commands that draw them, and the drawing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import say
from colony.extras import expect_extras
from colony.text.wording import time_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from colony.ir.frame import Frame, Outcome
    from colony.ir.program import Program
    from colony.verify.testing.examples import ExampleResult


def check_picture(picture: Path, inputs: Iterable[str]) -> None:
    """Refuse a picture that cannot be drawn or written, before the work begins; exit with 2."""
    expect_extras("sim")
    from colony.view.map_picture import picture_format

    try:
        picture_format(picture)
    except ValueError as problem:
        raise click.UsageError(f"--picture: {problem}", click.get_current_context()) from None
    check_output(picture, list(inputs))


def expect_bearings(program: Program, subject: str) -> None:
    """Refuse a program, called `subject`, in which no sensor is an array with bearings; exit with 2."""
    from colony.view.polar_picture import arrays_with_bearings

    if not arrays_with_bearings(program):
        say(
            f"{subject}: error: --picture: found no sensor with bearings; expected an array such as "
            "`sensor sonar[24] : mm bearing -180 deg ...`"
        )
        raise click.exceptions.Exit(EXIT_MISUSE)


def refuse_frame(subject: str, number: int, first: int, last: int) -> None:
    """Report that `subject` has no frame with this number; exit with 2."""
    has = "it has no frame" if last < first else f"it has frames {first} to {last}"
    say(f"{subject}: error: --frame: found no frame {number}; {has}")
    raise click.exceptions.Exit(EXIT_MISUSE)


def draw_frame(
    picture: Path,
    program: Program,
    title: str,
    frame: Frame,
    outcome: Outcome,
    active: Sequence[str] | None,
) -> None:
    """Draw a frame into the file `picture`, and report that; exit with 2 if it cannot be written.

    `active` has the modules that were active, None if that is unknown.
    """
    from colony.verify.snapshot import snapshot_of
    from colony.view.map_picture import encode_picture, picture_format
    from colony.view.polar_picture import draw_scene, scene_of

    read = snapshot_of(program, frame).readings
    scene = scene_of(program, title, frame, read, list(decision_lines(program, outcome, active)))
    write_whole(picture, encode_picture(draw_scene(scene), picture_format(picture)))
    say(f"drawn in {picture}: {title}")


def decision_lines(program: Program, outcome: Outcome, active: Sequence[str] | None) -> Iterator[str]:
    """Yield a line for each actuator, then the active modules and the broken contracts."""
    from colony.verify.contracts.table import decision_text

    actuators = {a.name: a for a in program.robot.actuators}
    for decision in outcome.decisions:
        yield f"{decision.actuator} {decision_text(actuators[decision.actuator], decision)}"
    if active is not None:
        yield f"active: {', '.join(active) or 'no module'}"
    if outcome.breaches:
        yield f"broken: {', '.join(outcome.breaches)}"


def frame_title(subject: str, number: int, t_ns: int) -> str:
    """Return the title of a picture: `wander.colony, frame 120 at 6 s`."""
    return f"{subject}, frame {number} at {time_text(t_ns)}"


def draw_test(
    picture: Path, program: Program, file: str, results: Sequence[ExampleResult], number: int | None
) -> None:
    """Draw a frame of a test: frame `number`, by default the first in which it fails, else its last.

    Exits with 2 if `results` are not those of one test, or if it has no such frame.
    """
    from colony.verify.reference.interpreter import Interpreter
    from colony.verify.testing.frames import frames_of, snapshots_of

    if len(results) != 1:
        found = f"found {len(results)} tests; expected one: choose it with --only NAME"
        say(f"{file}: error: --picture: {found if program.tests else 'the file has no tests'}")
        raise click.exceptions.Exit(EXIT_MISUSE)
    [result] = results
    expect_bearings(program, file)
    example = next(e for e in program.tests if e.span == result.span)
    frames, snapshots = frames_of(program, example), snapshots_of(program, example)
    if number is None:
        failed_ns = min((failure.t_ns for failure in result.failures), default=frames[-1].t_ns)
        number = next(k for k, frame in enumerate(frames) if frame.t_ns == failed_ns)
    if number >= len(frames):
        refuse_frame(f'{file}: "{result.name}"', number, 0, len(frames) - 1)
    interpreter = Interpreter(program)
    outcome = None
    for snapshot in snapshots[: number + 1]:
        outcome = interpreter.step_in_base_units(
            snapshot.t_ns, snapshot.readings, restarted=snapshot.restarted
        )
    assert outcome is not None
    title = frame_title(result.name, number, frames[number].t_ns)
    draw_frame(picture, program, title, frames[number], outcome, interpreter.active_modules())
