"""The front door: what `import colony` has does what its docstrings and its page show, and is light."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given

import colony
from colony import testing
from colony.ir.frame import Frame
from colony.verify.contracts.results import Proved, Refuted
from colony.verify.difference.results import Different, Same
from tests.paths import ROOT

TEXT = """
robot toy {
  sensor   bumper : bool from Base.bumper within 200 ms
  sensor   near   : m range 0 .. 10 from Lidar.near
  actuator drive { velocity : mm/s range -600 .. 600 } to Base.drive idle drive(velocity = 0)
}
module cruise   { when near > 0.5 m do drive(velocity = 400 mm/s) }
module back_off { when bumper       do drive(velocity = -100 mm/s) }
network { drive = back_off suppresses cruise }
contract never_ram: bumper implies drive.velocity <= 0 mm/s
"""
PROGRAM = colony.loads(TEXT, name="toy.colony")


def test_the_docstring_of_the_package() -> None:
    assert doctest.testmod(colony) == (0, 4)


def test_the_page() -> None:
    page = ROOT / "docs" / "library.md"
    failed, tried = doctest.testfile(str(page), module_relative=False, optionflags=doctest.ELLIPSIS)
    assert (failed, tried > 10) == (0, True)
    text = page.read_text()
    for name in colony.__all__:
        assert f"`{name}" in text or f", `{name}" in text or name == "__version__", name


def test_the_first_screen_of_the_readme(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    block = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[0]
    exec(block, {})
    assert capsys.readouterr().out == "cruise (600.0, 0.0)\n"


def test_a_file_is_loaded_and_errors_have_places(tmp_path: Path) -> None:
    path = tmp_path / "toy.colony"
    path.write_text(TEXT)
    assert colony.load(path).robot == colony.loads(TEXT, name=str(path)).robot
    with pytest.raises(colony.Failure) as caught:
        colony.loads(TEXT.replace("0.5 m", "0.5 s"), name="toy.colony")
    assert "toy.colony:7:" in str(caught.value)


def test_every_form_of_a_build() -> None:
    build = colony.build(PROGRAM)
    assert "back_off" in build.table()
    assert '"format": "colony-clients/1"' in build.to_json()
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

    import colony.compile.pipeline as pipeline

    original = pipeline.compile_program

    def wrong(program: object) -> pipeline.Compilation:
        compilation = original(program)  # type: ignore[arg-type]
        actuators = (replace(right.actuators[0], clients=swapped),)
        return replace(compilation, clients=replace(right, actuators=actuators))

    monkeypatch.setattr(pipeline, "compile_program", wrong)
    with pytest.raises(colony.Failure, match="V001"):
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
    from tests.verify.audit.recorded_runs import as_mcap, logs

    frames = tuple(Frame(k * 50_000_000, {"bumper": k % 5 == 0, "near": 1.0}) for k in range(20))
    path = tmp_path / "run.mcap"
    path.write_bytes(as_mcap(PROGRAM, logs(PROGRAM, frames)).content)
    assert [f.verdicts["drive"].by for f in colony.recorded(path, PROGRAM)][:2] == ["back_off", "cruise"]
    report = colony.audit(path, PROGRAM)
    assert (report.agrees, report.compared, report.damaged) == (True, 20, ())
    with pytest.raises(colony.Failure, match="A001"):
        colony.audit(tmp_path / "none.mcap", PROGRAM)


@given(testing.traces(PROGRAM))
def test_a_property_of_a_behavior(trace: tuple[Frame, ...]) -> None:
    for frame, outcome in testing.check(PROGRAM, trace):
        if frame.readings.get("bumper") is True:
            assert outcome.commands["drive"].by == "back_off"


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
