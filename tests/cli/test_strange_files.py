"""Every command that reads a file, on files that nobody means to be read: an error at once, and little more
memory than what the command takes anyway."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from colony.cli import compile
from colony.dsl import files as dsl_files
from colony.execute import colonyc
from colony.files import size_text
from colony.nav.maps import source as map_source
from colony.runs import compiled
from colony.runtime.recordings import mcap_reader, replay
from colony.runtime.transport.live import security
from colony.vision import image_files
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, WANDER
from tests.paths import ROOT
from tests.sampling import sampled
from tests.waiting import PATIENCE_S

MEMORY_MB = 300
"""Megabytes beyond what `--help` takes."""

SIZE = 2 << 30

USERS = ("--connect", "tls/127.0.0.1:1", "--security", "FILE.toml")

COMMANDS: dict[str, tuple[str, ...]] = {
    "check": ("check", "FILE.colony"),
    "compile": ("compile", "FILE.colony"),
    "compile --prove": ("compile", WANDER, "--prove", "FILE.json"),
    "compile --prove, Python": ("compile", WANDER, "--prove", "FILE.py"),
    "graph": ("graph", "FILE.colony"),
    "test": ("test", "FILE.colony"),
    "verify": ("verify", "FILE.colony"),
    "verify --write-test": ("verify", "FILE.colony", "--write-test"),
    "diff, the first": ("diff", "FILE.colony", WANDER),
    "diff, the second": ("diff", WANDER, "FILE.colony"),
    "trace": ("trace", "FILE.colony", "--input", "frames"),
    "trace --input": ("trace", WANDER, "--input", "FILE.jsonl"),
    "trace --input, MCAP": ("trace", WANDER, "--input", "FILE.mcap"),
    "run": ("run", "FILE.colony", "--map", MAP),
    "run --map": ("run", WANDER, "--map", "FILE.stickrep"),
    "drive --security": ("drive", WANDER, "--robot", "rome", *USERS),
    "serve all": ("serve", "all", "--robot", "rome", "--map", "FILE.stickrep"),
    "serve Gateway": (*("serve", "Gateway", "--robot", "rome", "--listen", "tls/127.0.0.1:0"), *USERS[2:]),
    "watch": ("watch", "FILE.mcap"),
    "watch --security": ("watch", "--robot", "rome", *USERS),
    "ps": ("ps", "--robot", "rome", *USERS),
    "stop": ("stop", "--robot", "rome", *USERS),
    "data": ("data", "list", "--robot", "rome", *USERS),
    "audit": ("audit", "FILE.jsonl"),
    "audit, with a behavior": ("audit", "FILE.mcap", WANDER),
    "audit, the behavior": ("audit", "recording", "FILE.colony"),
    "map": ("map", "FILE.stickrep"),
    "plan": ("plan", "FILE.stickrep", "101", "102"),
    "sim snapshot": ("sim", "snapshot", "FILE.stickrep", "--at", "101"),
    "vision": ("vision", "FILE.png"),
    "robot check": ("robot", "check", "FILE.colony"),
    "robot show": ("robot", "show", "FILE.colony"),
}
"""The commands that read a file, each with the ending that it expects of its name."""

READABLE = ("nothing", "a name that is no text")
"""Files that a command may read: of these it is asked only that it ends, and how."""


def strange_files(folder: Path, suffix: str) -> dict[str, Path]:
    """One file of each kind, by what it is."""
    folder.mkdir()
    files = {
        "a pipe": folder / "pipe",
        "a device without an end": folder / "zero",
        "a device that waits": folder / "kmsg",
        "a folder": folder / "folder",
        "a socket": folder / "socket",
        "2 GiB of zeros": folder / "zeros",
        "2 GiB without the end of a line": folder / "line",
        "nothing": folder / "empty",
        "a name that is no text": Path(os.fsdecode(os.fsencode(folder) + b"/n\xff\x1b[31m\n")),
    }
    files = {kind: path.with_name(path.name + suffix) for kind, path in files.items()}
    os.mkfifo(files["a pipe"])
    files["a device without an end"].symlink_to("/dev/zero")
    files["a device that waits"].symlink_to("/dev/kmsg")
    files["a folder"].mkdir()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(files["a socket"]))
    for kind, begin in (("2 GiB of zeros", b""), ("2 GiB without the end of a line", b'{"t": 0, "x": "')):
        files[kind].write_bytes(begin)
        os.truncate(files[kind], SIZE)
    for kind in READABLE:
        files[kind].touch()
    if os.geteuid() != 0:  # who is root may read everything
        files["a file that may not be read"] = folder / f"secret{suffix}"
        files["a file that may not be read"].touch(mode=0)
    return files


def ran(folder: Path, command: tuple[str, ...], files: list[Path]) -> list[dict[str, Any]]:
    """What came of the command's `--help`, and of each file."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "COLONY_RUN_DIR": str(folder / "r"),
        "XDG_STATE_HOME": str(folder / "s"),
    }
    child = subprocess.run(
        [
            sys.executable,
            "-m",
            "tests.cli.strange_files_child",
            json.dumps(command),
            *map(os.fsencode, files),
        ],
        capture_output=True,
        cwd=folder,
        env=environment,
        timeout=PATIENCE_S * (len(files) + 2),
    )
    lines = child.stdout.splitlines()
    assert len(lines) == 1 + len(files), f"ended at file {len(lines)} of {files}: {child.stderr.decode()}"
    return [json.loads(line) for line in lines]


@pytest.mark.parametrize("name", sampled(tuple(COMMANDS), every=12, thorough=True))
def test_strange_files(tmp_path: Path, name: str) -> None:
    (suffix,) = (Path(a).suffix for a in COMMANDS[name] if a.startswith("FILE"))
    command = tuple("FILE" if a.startswith("FILE") else a for a in COMMANDS[name])
    files = strange_files(tmp_path / "files", suffix)
    (tmp_path / "frames").write_text("")
    (tmp_path / "recording").write_text("{}\n")
    usual, *found = ran(tmp_path, command, list(files.values()))
    for (kind, path), one in zip(files.items(), found, strict=True):
        told = f"{kind}: {one}"
        assert one["peak_mb"] <= usual["peak_mb"] + MEMORY_MB, told
        assert "Traceback" not in one["err"], told
        assert "\x1b" not in one["err"], told
        if kind in READABLE:
            assert one["code"] in (0, 1, 2), told
            continue
        assert (one["code"], one["out"]) == (2, ""), told
        assert path.name in one["err"], told
        assert len(one["err"].splitlines()) <= 2, told  # the second is a hint
    print(f"{name}: {max(one['seconds'] for one in found):.2f} s at most")


def test_standard_input_is_read_as_it_comes_and_only_its_lines_are_bounded(tmp_path: Path) -> None:
    """From a pipe, which is what it is for: an endless line ends the command, not the memory."""
    command = [sys.executable, "-m", "colony.cli.main", "trace", WANDER, "--input", "-"]
    endless = ["sh", "-c", "while printf %65536d 0; do :; done"]
    with (
        subprocess.Popen(endless, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as source,
        subprocess.Popen(command, stdin=source.stdout, stderr=subprocess.PIPE, cwd=ROOT) as trace,
    ):
        source.stdout.close()
        _, said = trace.communicate(timeout=PATIENCE_S)
    assert said == b"<stdin>:1:1: error[F008]: cannot read the frames: line 1 is longer than 4 MiB\n"
    assert trace.returncode == 2


def test_an_import_that_is_no_file(tmp_path: Path, colony: Colony) -> None:
    os.mkfifo(tmp_path / "pipe.colony")
    (tmp_path / "b.colony").write_text('import "pipe.colony"\n')
    said = colony.refusal("check", "b.colony", code=1)
    assert "error[E103]: cannot read `pipe.colony`: it is not a regular file" in said


def test_an_import_that_is_too_large(tmp_path: Path, colony: Colony) -> None:
    (tmp_path / "big.colony").write_text("#" * (dsl_files.MAX_BYTES + 1))
    (tmp_path / "b.colony").write_text('import "big.colony"\n')
    said = colony.refusal("check", "b.colony", code=1)
    assert "b.colony:1:1: error[E103]: `big.colony` is larger than 4 MiB" in said


def test_a_module_that_is_too_large_is_left_out_of_recordings(tmp_path: Path, colony: Colony) -> None:
    (tmp_path / "large_plan.py").write_text(
        "class Plan:\n    def step(self, frame):\n        return None\n" + "#" * compiled.SOURCE_BYTES
    )
    (tmp_path / "b.colony").write_text(
        """
        robot rome {
          sensor   bumper : bool  from RServer.bumper
          actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive idle drive(velocity = 0, turn = 0)
        }
        module plan from python "large_plan:Plan" { reads bumper  commands drive }
        network { drive = plan }
        """
    )
    run = ("run", "b.colony", "--map", MAP, "--duration", "0.2", "--no-picture", "--record", "run.mcap")
    code, _, said = colony(*run)
    assert code == 0, said
    module = tmp_path / "large_plan.py"
    assert f"{module}: warning: cannot be included in the recording: it is larger than 4 MiB\n" in said


LIMITS = {
    "program, and each file that it imports": dsl_files.MAX_BYTES,
    "map": map_source.MAX_BYTES,
    "table of users, login, certificate, key": security.FILE_BYTES,
    "clients that `colony compile --prove` reads": compile.CLIENTS_BYTES,
    "a compiled program, `*.colonyc`": colonyc.MAX_BYTES,
    "program in a recording": mcap_reader.SOURCES_BYTES,
    "line of a recording, or of the standard input of `colony trace`": replay.LINE_BYTES,
}


def test_the_limits_on_the_page_are_those_of_the_code() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    for file, limit in LIMITS.items():
        assert f"| {file} | {size_text(limit)} |" in page, file
    module = size_text(compiled.SOURCE_BYTES)
    assert f"| module in Python, in a recording | {module}; a larger one is left out |" in page
    pixels = image_files.MAX_PIXELS // 10**6
    assert f"| picture | {size_text(image_files.MAX_BYTES)}, and {pixels} million pixels |" in page
