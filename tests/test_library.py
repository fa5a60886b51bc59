"""The front door: what `import colony` has does what its docstrings and its page show, and is light."""

from __future__ import annotations

import doctest
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given

import colony
from colony import testing
from colony.ir.frame import Frame, Reading
from colony.runs import compiled
from colony.verify.contracts.results import Proved, Refuted
from colony.verify.difference.results import Different, Same
from tests.cli.machine import MAP
from tests.pages import page_text
from tests.paths import ROOT

ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}

TEXT = """
robot toy {
  sensor   bumper : bool from Base.bumper within 200 ms
  sensor   near   : m range 0 .. 10 from Lidar.near
  actuator drive { velocity : mm/s range -600 .. 600 } to Base.drive idle drive(velocity = 0)
}
module cruise   { when near > 0.5 m do drive(velocity = 400 mm/s) }
module back_off { when bumper       do drive(velocity = -100 mm/s) }
network { drive = back_off suppresses cruise }
contract never_ram: fresh(bumper) and bumper implies drive.velocity <= 0 mm/s
"""
PROGRAM = colony.loads(TEXT, name="toy.colony")


def test_the_docstring_of_the_package() -> None:
    assert doctest.testmod(colony) == (0, 4)


def test_the_page_has_all_names() -> None:
    text = page_text("library.md")
    for name in colony.__all__:
        assert f"`{name}" in text or f", `{name}" in text or name == "__version__", name


def test_a_file_is_loaded_and_errors_have_places(tmp_path: Path) -> None:
    path = tmp_path / "toy.colony"
    path.write_text(TEXT)
    assert colony.load(path).robot == colony.loads(TEXT, name=str(path)).robot
    with pytest.raises(colony.DiagnosticError) as caught:
        colony.loads(TEXT.replace("0.5 m", "0.5 s"), name="toy.colony")
    assert "toy.colony:7:" in str(caught.value)


def test_every_form_names_the_failsafe_modules() -> None:
    build = colony.build(colony.loads(TEXT.replace("module back_off", "failsafe module back_off")))
    assert build.table().endswith(
        "\nFailsafe, active also where something that they read is missing: back_off"
    )
    assert '"failsafe": ["back_off"]' in build.to_json()
    assert "double border: failsafe" in build.graph()


def test_every_form_of_a_build() -> None:
    build = colony.build(PROGRAM)
    assert "back_off" in build.table()
    assert '"format": "colony-clients/1"' in build.to_json()
    assert '"failsafe": []' in build.to_json()
    assert build.graph().lstrip().startswith("<svg")
    frame = colony.Frame(t_ns=10**9, readings={"bumper": True, "near": 5}, taken_ns={"bumper": 7 * 10**8})
    outcome = build.executor().step(frame)
    assert (outcome.commands["drive"].by, outcome.commands["drive"].values) == ("cruise", (400.0,))
    namespace: dict[str, object] = {}
    exec(build.to_python(), namespace)
    decisions, _, _ = namespace["Program"]().step(*frame)  # type: ignore[operator]
    assert decisions == (("drive", "cruise", (400.0,), None),)


def test_a_proof_that_fails_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    right = colony.build(PROGRAM).compilation.clients
    swapped = right.actuators[0].clients[::-1]
    from dataclasses import replace

    from colony.compile.pipeline import Compilation

    original = compiled.compile_program

    def wrong(*given: Any) -> Compilation:
        compilation = original(*given)
        actuators = (replace(right.actuators[0], clients=swapped),)
        return replace(compilation, clients=replace(right, actuators=actuators))

    monkeypatch.setattr(compiled, "compile_program", wrong)
    with pytest.raises(colony.DiagnosticError, match="V001"):
        colony.build(PROGRAM)
    assert colony.build(PROGRAM, proof=False).compilation.clients.actuators[0].clients == swapped


def test_contracts_are_proved_or_refuted() -> None:
    (result,) = colony.prove(PROGRAM)
    assert isinstance(result, Proved)
    (result,) = colony.prove(colony.loads(TEXT.replace("-100 mm/s", "100 mm/s")))
    assert isinstance(result, Refuted)


def test_programs_are_compared() -> None:
    assert isinstance(colony.compare(PROGRAM, colony.loads(TEXT)), Same)
    assert isinstance(colony.compare(PROGRAM, colony.loads(TEXT.replace("400", "401"))), Different)


def test_a_recording_is_read_and_audited(tmp_path: Path) -> None:
    from tests.analysis.recorded_runs import as_mcap, logs

    frames = tuple(Frame(k * 50_000_000, {"bumper": k % 5 == 0, "near": 1.0}) for k in range(20))
    path = tmp_path / "run.mcap"
    path.write_bytes(as_mcap(PROGRAM, logs(PROGRAM, frames)).content)
    assert [f.verdicts["drive"].by for f in colony.recorded(path, PROGRAM)][:2] == ["back_off", "cruise"]
    report = colony.audit(path, PROGRAM)
    assert (report.agrees, report.compared, report.damaged) == (True, 20, ())
    with pytest.raises(colony.DiagnosticError, match="A001"):
        colony.audit(tmp_path / "none.mcap", PROGRAM)


@given(testing.traces(PROGRAM))
def test_a_property_of_a_behavior(trace: tuple[Frame, ...]) -> None:
    for frame, outcome in testing.check(PROGRAM, trace):
        if frame.readings["bumper"]:
            assert outcome.commands["drive"].by == "back_off"


def test_check_yields_readings_as_the_program_saw_them() -> None:
    text = """robot r { sensor near : m range 0 .. 5 from P.near  sensor rays[2] : m from P.rays
      sensor bumper : bool from P.bumper
      actuator drive { velocity : mm/s } to R.drive idle drive(velocity = 0) }
    module m { when near < 1 m and bumper and rays[0] < 1 m do drive(velocity = 1 mm/s) }
    network { drive = m }"""
    faulty: list[dict[str, Reading]] = [
        {"near": "high", "rays": (1.0, math.nan), "bumper": 1},  # type: ignore[dict-item]
        {"near": 7.0, "rays": [1.0, 2]},
        {"near": None, "rays": (1.0,), "bumper": True},
    ]
    frames = [Frame(i, readings) for i, readings in enumerate(faulty)]
    assert [dict(f.readings) for f, _ in testing.check(colony.loads(text), frames)] == [
        {"near": None, "rays": None, "bumper": None},
        {"near": 5.0, "rays": (1.0, 2), "bumper": None},
        {"near": None, "rays": None, "bumper": True},
    ]


def test_a_broken_contract_fails_a_property_test() -> None:
    of = colony.loads(TEXT.replace("-100 mm/s", "100 mm/s"))
    with pytest.raises(AssertionError, match="never_ram"):
        list(testing.check(of, [Frame(0, {"bumper": True})]))


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import colony, sys; colony.Frame; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"lark", "numpy", "z3", "zenoh", "hypothesis", "msgspec", "networkx", "click"}


def test_what_it_has_is_what_it_says() -> None:
    assert set(colony.__all__) <= set(dir(colony))
    for name in colony.__all__:
        assert getattr(colony, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'lodes'"):
        _ = colony.lodes  # type: ignore[attr-defined]


# --- files of compiled programs ----------------------------------------------------------------------

PARTS = """
robot toy {
  sensor   bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
module back_off { when bumper do drive(velocity = -100 mm/s, turn = 0) }
"""
WHOLE = """
import "parts/toy.colony"
module go from python "goes:Go" { reads bumper  commands drive }
network { drive = back_off suppresses go }
"""
GOES = """
class Go:
    def step(self, frame):
        return {"velocity": 200.0, "turn": 0.0}
"""


@pytest.fixture
def whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A behavior of two files, with a module in Python beside it."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "toy.colony").write_text(PARTS)
    (tmp_path / "whole.colony").write_text(WHOLE)
    (tmp_path / "goes.py").write_text(GOES)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "goes", raising=False)
    return tmp_path / "whole.colony"


@pytest.mark.parametrize("how", ["load", "loads"])
def test_a_build_is_saved_with_all_sources_and_read(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    program = colony.load(whole) if how == "load" else colony.loads(WHOLE, "whole.colony", tmp_path)
    colony.build(program).save(tmp_path / "whole.colonyc")
    read = colony.read(tmp_path / "whole.colonyc")
    assert [source.path for source in read.compiled.sources] == [
        "parts/toy.colony",
        "whole.colony",
        "goes.py",
    ]
    assert read.compiled.root == "whole.colony"
    frames = [Frame(0, {"bumper": False}), Frame(1, {"bumper": True})]
    built, robot = colony.build(program).executor(), read.executor()
    assert [robot.step(frame) for frame in frames] == [built.step(frame) for frame in frames]
    assert read.to_python() == colony.build(program).to_python().replace(f"{tmp_path}/", "")
    whole.unlink()
    recording = tmp_path / "run.mcap"
    options = ("--map", MAP, "--duration", "0.5", "--no-picture", "--record", str(recording))
    for command in (("run", str(tmp_path / "whole.colonyc"), *options), ("audit", str(recording))):
        done = subprocess.run(
            [sys.executable, "-m", "colony.cli.main", *command], cwd=tmp_path, env=ENVIRONMENT
        )
        assert done.returncode == 0


def test_what_colony_compile_writes_is_the_same(tmp_path: Path) -> None:
    wander = ROOT / "behaviors" / "wander.colony"
    command = ("compile", str(wander), "-o", str(tmp_path / "cli.colonyc"))
    subprocess.run([sys.executable, "-m", "colony.cli.main", *command], check=True, env=ENVIRONMENT)
    colony.build(colony.load(wander)).save(tmp_path / "library.colonyc")
    assert (tmp_path / "cli.colonyc").read_bytes() == (tmp_path / "library.colonyc").read_bytes()


def test_files_that_cannot_be_saved_or_read(whole: Path, tmp_path: Path) -> None:
    build = colony.build(colony.load(whole))
    with pytest.raises(ValueError, match=r"ends in \.colonyc"):
        build.save(whole)
    assert whole.read_text() == WHOLE
    with pytest.raises(FileNotFoundError):
        build.save(tmp_path / "no" / "such.colonyc")
    with pytest.raises(colony.DiagnosticError, match="C001"):
        colony.build(colony.loads(TEXT, name="a\nb")).save(tmp_path / "odd.colonyc")
    for name in ("none.colonyc", "whole.colony"):
        with pytest.raises(colony.DiagnosticError, match="C001"):
            colony.read(tmp_path / name)
    build.save(tmp_path / "whole.colonyc")
    (tmp_path / "goes.py").write_text(GOES.replace("200", "300"))
    with pytest.raises(colony.DiagnosticError, match=r"`goes\.py` has changed since it was compiled"):
        colony.read(tmp_path / "whole.colonyc")


# --- arguments ---------------------------------------------------------------------------------------

WRONG: dict[str, Callable[[], Any]] = {
    "found None; expected the path": lambda: colony.load(None),  # type: ignore[arg-type]
    "found b'robot r {}'; expected the text": lambda: colony.loads(b"robot r {}"),  # type: ignore[arg-type]
    "found None; expected the text": lambda: colony.loads(None),  # type: ignore[arg-type]
    "found 5; expected the name": lambda: colony.loads(TEXT, 5),  # type: ignore[arg-type]
    "found 5; expected the path": lambda: colony.read(5),  # type: ignore[arg-type]
    "found 'x.colony'; expected a program": lambda: colony.build("x.colony"),  # type: ignore[arg-type]
    "found None; expected a program": lambda: colony.prove(None),  # type: ignore[arg-type]
    "found Build.*; expected a program": lambda: colony.compare(PROGRAM, colony.build(PROGRAM)),  # type: ignore[arg-type]
    "found 'y.colony'; expected a program": lambda: colony.audit("run.mcap", "y.colony"),  # type: ignore[arg-type]
    "found 'z.colony'; expected a program": lambda: colony.recorded("run.mcap", "z.colony"),  # type: ignore[arg-type]
    "found 7; expected the path": lambda: colony.audit(7, PROGRAM),  # type: ignore[arg-type]
    "found 'long'; expected seconds": lambda: colony.prove(PROGRAM, seconds="long"),  # type: ignore[arg-type]
    "found 'deep'; expected the maximum k": lambda: colony.prove(PROGRAM, depth="deep"),  # type: ignore[arg-type]
    "found 'traces'; expected a program": lambda: testing.traces("traces"),  # type: ignore[arg-type]
    "found 'frames'; expected a program": lambda: testing.frames("frames"),  # type: ignore[arg-type]
    "found 'check'; expected a program": lambda: list(testing.check("check", [])),  # type: ignore[arg-type]
    "found 1; expected frames": lambda: testing.disagreement(PROGRAM, 1),  # type: ignore[arg-type]
    "found 'a'; expected a colony.Frame": lambda: list(testing.check(PROGRAM, "a")),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("expected", WRONG)
def test_an_argument_of_another_type_is_one_clear_error(expected: str) -> None:
    with pytest.raises(TypeError, match=expected):
        WRONG[expected]()


def test_numbers_out_of_range_are_one_clear_error() -> None:
    for seconds in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="seconds: found"):
            colony.prove(PROGRAM, seconds=seconds)
    with pytest.raises(ValueError, match="max_frames: found 0"):
        testing.traces(PROGRAM, max_frames=0)


def test_what_is_no_frame_is_refused() -> None:
    with pytest.raises(TypeError, match="found None"):
        colony.build(PROGRAM, proof=False).executor().step(None)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="t_ns: found 0 after 0"):
        list(testing.check(PROGRAM, [Frame(0, {})] * 2))


def test_a_trace_may_be_an_iterator() -> None:
    frames = [Frame(k, {"bumper": False, "near": 5}) for k in range(3)]
    assert [frame for frame, _ in testing.check(PROGRAM, iter(frames))] == frames


def test_stepping_does_not_import_numpy() -> None:
    code = (
        f"import colony, sys; colony.build(colony.loads('''{TEXT}''')).executor().step(colony.Frame(0, {{}}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    assert not set(done.stdout.split()) & {"numpy", "zenoh", "click"}


def test_load_takes_the_params_of_a_site(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    site.write_text('roaming = "250 mm/s"\n[avoid]\nclearance = "0.7 m"\n')
    by_file = colony.load("wander", params=site)
    assert by_file == colony.load("wander", params={"roaming": "250 mm/s", "avoid": {"clearance": "0.7 m"}})
    assert by_file != colony.load("wander")
    with pytest.raises(colony.DiagnosticError) as refused:
        colony.load("wander", params={"roaming": 250, "avoid.cleerance": "1 m"})
    assert [d.code for d in refused.value.diagnostics] == ["E704", "E703"]
    with pytest.raises(TypeError, match="a mapping of names to values"):
        colony.load("wander", params=3)  # type: ignore[arg-type]
