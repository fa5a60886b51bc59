"""Lines from a pipe, a terminal and nowhere, read without waiting."""

from __future__ import annotations

import io
import os
import pty
import subprocess
import sys

import pytest

from colony.cli.terminal import Terminal


def test_lines_of_a_pipe_all_count_also_before_the_question() -> None:
    read, write = os.pipe()
    with open(read) as stream, open(write, "wb", buffering=0) as sender:
        terminal = Terminal(stream)
        assert terminal.poll() == "nothing"
        sender.write(b"\nye")
        terminal.discard()
        assert [terminal.poll(), terminal.poll()] == ["line", "nothing"]
        sender.write(b"s\n\n")
        assert [terminal.poll(), terminal.poll(), terminal.poll()] == ["line", "line", "nothing"]
        sender.close()
        assert [terminal.poll(), terminal.poll()] == ["end", "end"]


def test_what_stands_in_a_pipe_that_has_ended_is_still_heard() -> None:
    read, write = os.pipe()
    os.write(write, b"\nhalf")
    os.close(write)
    with open(read) as stream:
        terminal = Terminal(stream)
        assert [terminal.poll(), terminal.poll()] == ["line", "end"]


def test_what_was_typed_at_a_terminal_before_the_question_is_forgotten() -> None:
    keyboard, screen = pty.openpty()
    with open(screen) as stream, open(keyboard, "wb", buffering=0) as keys:
        terminal = Terminal(stream)
        keys.write(b"\n\n")
        assert terminal.poll() == "line"
        terminal.discard()
        assert terminal.poll() == "nothing"
        keys.write(b"\n")
        assert terminal.poll() == "line"


_IN_BACKGROUND = """
import sys
from colony.cli.terminal import Terminal
terminal = Terminal(sys.stdin)
terminal.discard()
print(terminal.poll())
"""

_SHELL = """
import fcntl, os, subprocess, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
job = subprocess.Popen([sys.executable, "-c", sys.argv[1]], process_group=0)
_, status = os.waitpid(job.pid, os.WUNTRACED)
if os.WIFSTOPPED(status):
    job.kill()
    print("stopped")
"""


def test_a_job_in_the_background_leaves_the_terminal_alone() -> None:
    """The system stops who does not."""
    keyboard, screen = pty.openpty()
    with open(screen) as stream, open(keyboard, "wb", buffering=0) as keys:
        keys.write(b"\n")
        shell = subprocess.run(
            [sys.executable, "-c", _SHELL, _IN_BACKGROUND],
            stdin=stream,
            capture_output=True,
            text=True,
            timeout=60.0,
            start_new_session=True,
        )
    assert (shell.stdout, shell.stderr) == ("nothing\n", "")


@pytest.mark.parametrize("stream", [None, io.StringIO("\n")], ids=["none", "no file"])
def test_without_a_standard_input_there_is_nobody(stream: io.StringIO | None) -> None:
    assert Terminal(stream).poll() == "end"


def test_an_empty_file_has_nobody() -> None:
    with open(os.devnull) as stream:
        assert Terminal(stream).poll() == "end"
