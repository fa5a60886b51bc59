"""What a process of a robot prints into a log that takes nothing is dropped, and changes nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from colony.runtime.assembly.processes.shutdown import EXIT_FAILED, EXIT_FINAL

BEGIN = """
import sys
from colony.runtime.assembly.processes.shutdown import (
    make_printing_safe, exit_with, exit_if_out_of_resources, log_line,
)
make_printing_safe()
print("from a module", end="", flush=True)
print("from a module", file=sys.stderr)
log_line("from a server")
"""

LAST = [
    ("", 0),
    ("exit_with('wrong')", EXIT_FINAL),
    ("exit_if_out_of_resources(MemoryError())", EXIT_FAILED),
    ("exit_if_out_of_resources(OSError(28, 'No space left on device', 'a file'))", EXIT_FAILED),
    ("exit_if_out_of_resources(KeyError('a bug'))", 1),
]


@pytest.mark.parametrize(("last", "code"), LAST)
def test_a_full_log_changes_nothing(last: str, code: int) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    with open("/dev/full", "wb") as full:
        done = subprocess.run([sys.executable, "-u", "-c", BEGIN + last], stdout=full, stderr=full)
    assert done.returncode == code


def test_what_can_be_printed_is() -> None:
    command = [sys.executable, "-u", "-c", BEGIN + LAST[3][0]]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.stdout == ("from a modulefrom a module\nfrom a server\na file: No space left on device\n")


def test_a_bug_is_still_shown() -> None:
    done = subprocess.run([sys.executable, "-c", BEGIN + LAST[4][0]], capture_output=True, text=True)
    assert "KeyError: 'a bug'" in done.stderr
