"""`colony audit` from end to end: on what `colony run` recorded, whole, changed and broken off."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.writer import Writer

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from tests.cli.conftest import Colony
from tests.cli.explained import recorded as recorded_run
from tests.cli.run.test_run import MAP, ROAM
from tests.commands import Ran
from tests.paths import ROOT
from tests.runtime.recordings.test_mcap import messages


@pytest.fixture(scope="module")
def kept() -> dict[tuple[str, ...], tuple[Ran, bytes]]:
    """What runs said and recorded, by program, kind of recording and duration."""
    return {}


@pytest.fixture
def recorded(
    colony: Colony, tmp_path: Path, kept: dict[tuple[str, ...], tuple[Ran, bytes]]
) -> Callable[..., Ran]:
    """Records a run of `roam.colony` into a file of this name; gives what was said."""
    (tmp_path / "roam.colony").write_text(ROAM)

    def record(name: str = "run.mcap", file: str = "roam.colony", duration: str = "3") -> Ran:
        of = (file, Path(file).read_text(), name, duration)
        if of not in kept:
            ran = colony("run", file, "--map", MAP, "--no-picture", "--duration", duration, "--record", name)
            assert ran.code == 0
            kept[of] = ran, Path(name).read_bytes()
        ran, data = kept[of]
        Path(name).write_bytes(data)
        return ran

    return record


def test_times_of_an_audit_are_those_of_the_run(colony: Colony) -> None:
    for begin_ns in (0, 89_751_399_999):
        Path("run.mcap").write_bytes(recorded_run(begin_ns=begin_ns))
        assert "100 frames from 0 s to 4.95 s" in colony("audit", "run.mcap", "wander").out


def test_json_lines_do_not_contain_their_program(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded("run.jsonl")
    err = colony.refusal("audit", "run.jsonl")
    assert "error[A005]: a recording as JSON lines does not contain its program" in err


def test_as_json(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded()
    row = json.loads(colony("audit", "run.mcap", "--format", "json").out)
    assert row["agrees"] is True
    assert (row["program"], row["robot"], row["seed"], row["run"]) == ("roam.colony", "rome", 0, "")
    assert (row["frames"], row["compared"], row["first"], row["truncated"]) == (60, 60, None, None)


def test_a_recording_holds_the_requests_of_all_clients(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded()
    found = messages(Path("run.mcap").read_bytes())["/requests/drive"]
    assert len(found) == 60
    assert all(set(row["clients"]) == {"avoid", "cruise", "stagger"} for row in found)


def test_a_recording_of_another_program_differs(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded()
    Path("roam.colony").write_text(ROAM.replace("velocity = 500 mm/s", "velocity = 501 mm/s"))
    code, out, _ = colony("audit", "run.mcap", "roam.colony")
    assert (code, "DIFFERS in 60 frames, first at 0 s (frame 0), drive" in out) == (1, True)


def test_a_program_of_several_files(colony: Colony, recorded: Callable[..., Ran], tmp_path: Path) -> None:
    split = ROAM.index("module cruise")
    (tmp_path / "robots").mkdir()
    (tmp_path / "behaviors" / "mine").mkdir(parents=True)
    (tmp_path / "robots" / "rome.colony").write_text(ROAM[:split])
    (tmp_path / "behaviors" / "mine" / "roam.colony").write_text(
        'import "../../robots/rome.colony"\n' + ROAM[split:]
    )
    recorded(file="behaviors/mine/roam.colony")
    (tmp_path / "robots" / "rome.colony").unlink()
    assert colony.output("audit", "run.mcap").startswith("run.mcap: behaviors/mine/roam.colony, seed 0")


def test_a_program_with_import_robot_has_the_robot_that_it_was_recorded_with(
    colony: Colony, recorded: Callable[..., Ran], tmp_path: Path
) -> None:
    split = ROAM.index("module cruise")
    (tmp_path / "robots").mkdir()
    (tmp_path / "behaviors").mkdir()
    (tmp_path / "robots" / "base.colony").write_text(ROAM[:split])
    (tmp_path / "robots" / "better.colony").write_text('import "base"\nlet unused = now\n')
    (tmp_path / "behaviors" / "roam.colony").write_text("import robot\nlet also = unused\n" + ROAM[split:])
    (tmp_path / "colony.toml").write_text('robot = "better"\n')
    recorded(file="behaviors/roam.colony")
    for gone in ("colony.toml", "robots/base.colony", "robots/better.colony"):
        (tmp_path / gone).unlink()
    result = colony("audit", "run.mcap")
    assert (result.code, result.err) == (0, "")
    assert result.out.startswith("run.mcap: behaviors/roam.colony, seed 0")


def test_an_absolute_import_asks_for_the_file(
    colony: Colony, recorded: Callable[..., Ran], tmp_path: Path
) -> None:
    split = ROAM.index("module cruise")
    (tmp_path / "rome.colony").write_text(ROAM[:split])
    (tmp_path / "mine.colony").write_text(f'import "{tmp_path}/rome.colony"\n' + ROAM[split:])
    recorded(file="mine.colony")
    result = colony("audit", "run.mcap")
    assert (result.code, len(result.err.splitlines())) == (2, 1)
    assert "error[A005]: its program has errors: mine.colony:1:1: error[E103]: " in result.err
    assert f"`{tmp_path}/rome.colony` is not part of the recorded program" in result.err
    assert colony("audit", "run.mcap", "mine.colony").code == 0


def test_a_recording_that_breaks_off(colony: Colony, recorded: Callable[..., Ran]) -> None:
    for name, arguments in (("run.mcap", ()), ("run.jsonl", ("roam.colony",))):
        recorded(name)
        data = Path(name).read_bytes()
        Path(name).write_bytes(data[: len(data) * 2 // 3])
        out = colony.output("audit", name, *arguments)
        assert "  truncated: it breaks off in the middle of a frame; audited as far as it goes" in out
        assert json.loads(colony("audit", name, *arguments, "--format", "json").out)["truncated"]
        traced = colony("trace", "roam.colony", "--input", name)
        assert (traced.code, bool(traced.out)) == (0, True)
        assert traced.err == f"{name}: it breaks off in the middle of a frame; decided as far as it goes\n"


@pytest.mark.parametrize("name", ["run.mcap", "run.jsonl"])
def test_a_recording_that_is_damaged(colony: Colony, recorded: Callable[..., Ran], name: str) -> None:
    recorded(name)
    data = bytearray(Path(name).read_bytes())
    middle = len(data) * 11 // 20
    data[middle if name == "run.jsonl" else data.index(b"zstd", middle) + 20] ^= 1
    whole = colony("trace", "roam.colony", "--input", name).out.splitlines()
    Path(name).write_bytes(bytes(data))
    result = colony("audit", name, "roam.colony")
    assert (result.code, result.err) == (1, "")
    told = re.search(
        r"^  damaged from ([\d.]+) s to (?:([\d.]+) s|its end): left out$", result.out, re.MULTILINE
    )
    assert float(told[2] or 2.95) - float(told[1]) <= 0.5
    assert result.out.endswith("is the interpreter's, as far as the recording is not damaged\n")
    row = json.loads(colony("audit", name, "roam.colony", "--format", "json").out)
    assert (row["agrees"], len(row["damaged"]), row["frames"] >= 50) == (True, 1, True)
    for backend in ("network", "clients", "python"):
        traced = colony("trace", "roam.colony", "--input", name, "--backend", backend)
        assert traced.code == 1
        assert traced.err.startswith(f"{name}: error: damaged from {told[1]} s to ")
        assert ("not decided" in traced.err) is (backend != "network" or name == "run.jsonl")
        assert set(traced.out.splitlines()) < set(whole)
        assert len(traced.out.splitlines()) >= (45 if backend == "network" else 15)


@pytest.mark.parametrize("length", [1, 4096])
def test_a_recording_in_lines_that_is_damaged_at_its_beginning(
    colony: Colony, recorded: Callable[..., Ran], length: int
) -> None:
    recorded("run.jsonl")
    data = Path("run.jsonl").read_bytes()
    Path("run.jsonl").write_bytes(bytes(length) + data[length:])
    result = colony("audit", "run.jsonl", "roam.colony")
    assert result.code == 1
    assert "  damaged to " in result.out


def test_a_recording_of_which_nothing_is_whole(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded()
    data = Path("run.mcap").read_bytes()
    Path("run.mcap").write_bytes(data.replace(b"colony-recording/2", b"colony-recordinh/2", 1))
    err = colony.refusal("audit", "run.mcap", code=1)
    assert "error[A006]: it is damaged before its first frame (metadata with a wrong checksum)" in err
    assert colony("trace", "roam.colony", "--input", "run.mcap").code == 1


def test_mcap_is_input_of_trace(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded()
    recorded("run.jsonl")
    one, other = (colony("trace", "roam.colony", "--input", name) for name in ("run.mcap", "run.jsonl"))
    assert one == other
    assert len(one.out.splitlines()) == 60


def test_texts_are_those_that_were_run(colony: Colony, behavior: Path) -> None:
    """A file that is saved after it was checked, and before the recording begins, is not recorded."""
    text, program = behavior.read_text(), load_file(behavior)
    behavior.write_text("# gone")
    compiled = compile_program(program).compiled
    (source,) = compiled.sources
    assert (compiled.root, source.path, source.data.decode()) == ("b.colony", "b.colony", text)


PYTHON = """
robot rome {
  sensor   bumper : bool  from RServer.bumper
  actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive  idle drive(velocity = 0, turn = 0)
}
module plan from python "audited.plan:Plan" { reads bumper  commands drive }
network { drive = plan }
"""

PLAN = """
import sys
from . import speeds
class Plan:
    def __init__(self):
        self.calls = 0
    def step(self, frame):
        self.calls += 1
        return {"velocity": speeds.SPEED + self.calls, "turn": 0.0} if self.calls % 4 else None
"""


@pytest.mark.parametrize("name", ["run.mcap", "run.jsonl"])
def test_no_python_is_run_for_what_it_answered_is_recorded(
    colony: Colony,
    recorded: Callable[..., Ran],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    import sys

    monkeypatch.setattr(sys, "path", list(sys.path))
    package = tmp_path / "audited"
    package.mkdir()
    files = {"__init__.py": "", "plan.py": PLAN, "speeds.py": "SPEED = 50.0\n"}
    for file, text in files.items():
        (package / file).write_text(text)
    (tmp_path / "planned.colony").write_text(PYTHON)
    recorded(name, file="planned.colony", duration="1")
    for module in [module for module in sys.modules if module.partition(".")[0] == "audited"]:
        monkeypatch.delitem(sys.modules, module)
    (package / "__init__.py").write_text("raise SystemExit('this is not run')\n")

    program = () if name.endswith("mcap") else ("planned.colony",)
    result = colony("audit", name, *program)
    assert (result.code, result.err) == (0, "")
    assert "20 decisions compared" in result.out
    assert not any(module.startswith("audited") for module in sys.modules)


def foreign() -> bytes:
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    writer.finish()
    return out.getvalue()


MISUSE: list[tuple[bytes | None, str]] = [
    (None, "run.mcap:1:1: error[A001]: cannot read the recording: No such file or directory"),
    (b"", "run.mcap:1:1: error[A002]: the recording is empty"),
    (b"\x89PNG....", "run.mcap:1:1: error[A002]: this is not a recording: neither MCAP nor JSON lines"),
    (foreign(), "run.mcap:1:1: error[A002]: this is MCAP, but not a recording of a run"),
    (b"\x89MCAP0\r\n\x01", "error[A002]: this is MCAP, but not a recording of a run: it breaks off"),
    (b'{"t": 0, "bumper": true}\n', "error[A003]: the recording contains no decision"),
    (b'{"t": 0, "near": 1}\n', "run.mcap:1:10: error[F005]: unknown sensor `near`"),
    (
        b'{"t": 0, "@tick": "x", "@semantics": 4}\n',
        "run.mcap:1:1: error[A004]: this is not a decision of this program",
    ),
    (b'{"t": 0, "@tick": 0, "drive": null}\n', "run.mcap:1:10: error[A007]: the recording is of version 1"),
    (b'{"t": 0, "drive": {"by": "cruise", "velocity": 1}}\n', "error[A004]"),
    (b'{"t": 0, "drive": {"fates": {"cruise": "asleep"}}}\n', "error[A004]"),
    (
        b'{"t": 0, "drive": 3}\n',
        "error[A004]: this is not a decision of this program: `drive` is not an object",
    ),
]


@pytest.mark.parametrize(("content", "text"), MISUSE)
def test_misuse_is_one_line_and_exit_code_2(
    colony: Colony, tmp_path: Path, content: bytes | None, text: str
) -> None:
    (tmp_path / "roam.colony").write_text(ROAM)
    if content is not None:
        (tmp_path / "run.mcap").write_bytes(content)
    result = colony("audit", "run.mcap", "roam.colony")
    assert (result.code, result.out, len(result.err.splitlines())) == (2, "", 1)
    assert text in result.err


def test_what_is_no_file(colony: Colony, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (".", "pipe", "/dev/zero"):
        result = colony("audit", name)
        assert (result.code, len(result.err.splitlines())) == (2, 1)
        why = "Is a directory" if name == "." else "it is not a regular file"
        assert f"error[A001]: cannot read the recording: {why}" in result.err


def test_a_killed_recording_without_frames(colony: Colony, recorded: Callable[..., Ran]) -> None:
    recorded(duration="0.05")
    data = Path("run.mcap").read_bytes()
    Path("run.mcap").write_bytes(data[: data.index(b"/frames") + 30])
    colony.refusal("audit", "run.mcap")


def test_errors_in_the_file_that_is_named(
    colony: Colony, recorded: Callable[..., Ran], tmp_path: Path
) -> None:
    recorded("run.jsonl")
    (tmp_path / "bad.colony").write_text("module {")
    assert colony("audit", "run.jsonl", "bad.colony").code == 1
    assert colony("audit", "run.jsonl", "nowhere.colony").code == 2


def test_progress_on_what_takes_long(
    colony: Colony, recorded: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded()
    monkeypatch.setattr("colony.cli.progress.PROGRESS_DELAY_S", -1.0)
    result = colony("audit", "run.mcap")
    said = result.err.splitlines()
    assert said == sorted(said, key=lambda line: int(line.split()[0]))
    assert said[-1] in ("70 %", "80 %", "90 %")


def test_of_behaviors_that_come_with_the_project(colony: Colony) -> None:
    for name, building in (("hallway", "hallway"), ("allen", "loop"), ("teleop", "loop")):
        file, plan = ROOT / "behaviors" / f"{name}.colony", ROOT / "maps" / f"{building}.stickrep"
        ran = colony("run", file, "--map", plan, "--no-picture", "--duration", "1", "--record", "run.mcap")
        assert ran.code == 0, name
        result = colony("audit", "run.mcap")
        assert result.code == 0, name
        assert all(line.endswith(" %") for line in result.err.splitlines()), name
        assert "20 frames" in result.out
