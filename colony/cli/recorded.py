"""The program by which a command reads a recording: that of a file, or the one in the recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from colony.cli.params_choice import chosen_params
from colony.cli.reporting import exit_with, load_program

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.runtime.recordings.recorded import RecordingReader


def program_for(reader: RecordingReader, recording: str, file: str | None, folder: Path) -> Program:
    """Return the program of `file`, or that of the recording, whose sources are unpacked into `folder`.

    Params of a site are those that the current command chose.
    Exits like `load_program`, also for errors that these params make.

    Raises:
        DiagnosticError: A005, there is no `file`, and the recording does not have the whole program; A006, it
            is damaged.
    """
    if file is not None:
        return load_program(file)
    from colony.analysis.recorded_program import recorded_program, unusable
    from colony.text.diagnostics import DiagnosticError

    if reader.run is None:
        raise DiagnosticError([unusable(recording, "a recording as JSON lines does not contain its program")])
    try:
        return recorded_program(reader.run, recording, folder, chosen_params())
    except DiagnosticError as failure:
        if failure.diagnostics[0].code in ("A005", "A006"):
            raise
        exit_with(failure.diagnostics)
