"""`colony export`: a recording as an MCAP file that Foxglove draws and plots."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.outputs import BEHAVIOR, check_output, map_option, write_to, write_whole
from colony.cli.params_choice import params_option
from colony.cli.progress import ReadingProgress
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, say
from colony.cli.robot_choice import description_option
from colony.cli.watch import scene_for
from colony.text.wording import counted

if TYPE_CHECKING:
    from colony.analysis.recording import OpenRecording
    from colony.ir.program import Program
    from colony.runtime.frames.run_frame import RunFrame

_PATH = click.Path(dir_okay=False, path_type=Path)


@click.command("export", short_help="write a recording for Foxglove")
@click.argument("recording", metavar="RECORDING")
@click.option("-o", "--output", type=_PATH, metavar="OUT.mcap", help="The file of messages to write.")
@click.option("--layout", type=_PATH, metavar="OUT.json", help="Write a layout of panels for these messages.")
@click.option(
    "--behavior",
    metavar="FILE",
    type=BEHAVIOR,
    help="The behavior of the recording; an MCAP recording contains it.",
)
@description_option()
@params_option()
@map_option
def command(
    recording: str, output: Path | None, layout: Path | None, behavior: str | None, map_path: str | None
) -> None:
    """Write a recording as messages that Foxglove draws: scans, the robot with its path, what limits watch,
    every actuator's command and bounds, who commands and why, broken contracts and assumptions.

    The output is an MCAP file with messages in JSON. `--layout` writes a file that Foxglove imports
    (Layouts, Import from file). A robot that runs is shown by `colony watch --robot NAME --foxglove`.

    Exit code: 0 if all frames were written, 1 if the recording or its program has errors, 2 if a file cannot
    be written.

    \b
    Example:
      colony run wander --map loop --record run.mcap
      colony export run.mcap -o foxglove.mcap --map loop --layout foxglove.json
    """
    outputs = [path for path in (output, layout) if path is not None]
    if not outputs:
        raise click.UsageError("give -o OUT.mcap, or --layout OUT.json", click.get_current_context())
    for path in outputs:
        check_output(path, [recording])
    from colony import __version__
    from colony.analysis.recording import OpenRecording
    from colony.text.diagnostics import DiagnosticError
    from colony.watch.foxglove.layout import layout_of
    from colony.watch.foxglove.messages import RunMessages
    from colony.watch.foxglove.sinks import write_mcap

    try:
        with OpenRecording.at(recording) as opened:
            program = program_for(opened, behavior)
            run = opened.reader.run
            scene = scene_for(program, "", map_path, None if run is None else run.robot)
            messages = RunMessages(program, scene)
            if layout is not None:
                topics = [channel.topic for channel in messages.channels]
                write_whole(layout, json.dumps(layout_of(scene, topics), indent=2) + "\n")
            if output is None:
                return
            with write_to(output) as file:
                count = write_mcap(file, messages, _frames(opened, program), f"colony {__version__}")
            problem = opened.reader.truncation
            for remark in (*([problem] if problem else []), *opened.reader.remarks):
                say(f"{recording}: {remark}")
            click.echo(f"wrote {output}: {counted(count, 'frame')}")
    except DiagnosticError as failure:
        refuse(failure.diagnostics)


def _frames(opened: OpenRecording, program: Program) -> Iterator[RunFrame]:
    """Yield the frames, reporting the progress."""
    progress = ReadingProgress(opened.stream) if opened.stream.seekable() else None
    for frame in opened.reader.frames(program):
        yield frame
        if progress is not None:
            progress()
