"""The program by which a command reads a recording: that of a file, or the one in the recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

from colony.cli.params_choice import choose_params, chosen_params
from colony.cli.reporting import exit_with, load_program

if TYPE_CHECKING:
    from colony.analysis.recording import OpenRecording
    from colony.ir.program import Program


def program_for(recording: OpenRecording, file: str | None) -> Program:
    """Return the program of `file`, or that of the recording.

    Params of a site are those that the current command chose, by default those in the recording.
    Exits like `load_program`, also for errors that these params make.

    Raises:
        DiagnosticError: A005, there is no `file`, and the recording does not have the whole program; A006, it
            is damaged.
    """
    from colony.text.diagnostics import DiagnosticError

    choose_params(recording.params)
    if file is not None:
        return load_program(file)
    try:
        return recording.program(chosen_params())
    except DiagnosticError as failure:
        if failure.diagnostics[0].code in ("A005", "A006"):
            raise
        exit_with(failure.diagnostics)
