"""Sessions where a process may open too few files: refused in words, before zenoh would panic."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from colony.runtime.transport.live.network import FREE_DESCRIPTORS
from tests.paths import ROOT

OPEN = """
import os, resource, sys
from colony.runtime.transport.live import network
from colony.runtime.transport.live.run_directory import UnreachableError
from colony.runtime.transport.live.robot_address import local
place = local("rome", {"COLONY_RUN_DIR": sys.argv[1]})
if sys.argv[2] == "unchecked":
    network._expect_descriptors = lambda: None
most = len(os.listdir("/proc/self/fd")) + int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
try:
    network.ZenohSession.open(place, server_names=("RServer",)).close()
except (UnreachableError, OSError) as problem:
    print(problem)
else:
    print("open")
"""


def opened(folder: Path, free: int, checked: str = "checked") -> str:
    """What comes of opening a session with so many descriptors free."""
    command = [sys.executable, "-c", OPEN, str(folder / "r"), checked, str(free)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_session_is_opened_where_there_are_enough(tmp_path: Path) -> None:
    assert opened(tmp_path, FREE_DESCRIPTORS + 16) == "open"


@pytest.mark.parametrize("free", [8, 16, 28])
def test_too_few_are_told_before(tmp_path: Path, free: int) -> None:
    said = opened(tmp_path, free)
    assert f"a session needs {FREE_DESCRIPTORS} more: raise the limit (`ulimit -n`)" in said


@pytest.mark.parametrize("free", range(2, 9))
def test_what_zenoh_makes_of_too_few_is_an_error_that_can_be_told(tmp_path: Path, free: int) -> None:
    """Without the check it panics, which is no Exception."""
    assert opened(tmp_path, free, "unchecked") not in ("", "open")
