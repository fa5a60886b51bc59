"""What modules in Python may do to a command: neither spoil its output nor end it unheard."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import ROOT

MAP = str(ROOT / "maps" / "loop.stickrep")

PROGRAM = """
robot rome {
  sensor   bumper : bool  from RServer.bumper
  actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive  idle drive(velocity = 0, turn = 0)
}
module plan from python "NAME:Plan" { reads bumper  commands drive }
network { drive = plan }
test "plans" { at 0 s given bumper = false expect drive is idle }
"""

STEPS = {
    "printing": "print('heard'); return None",
    "exiting": "raise SystemExit(3)",
    "failing": "raise ValueError('x')",
    "rubbish": "return 42",
}


def command(name: str, kind: str) -> tuple[str, ...]:
    match kind:
        case "run":
            return (
                "run",
                f"{name}.colony",
                "--map",
                MAP,
                "--duration",
                "0.1",
                "--no-picture",
                "--format",
                "json",
            )
        case "test":
            return ("test", f"{name}.colony", "--format", "json")
        case _:
            return ("trace", f"{name}.colony", "--input", "-", "--backend", kind)


@pytest.fixture
def modules(tmp_path: Path) -> None:
    """A behavior for each of `STEPS`. Names are of this test alone: imported modules stay imported."""
    for name, body in STEPS.items():
        (tmp_path / f"cli_{name}.py").write_text(f"class Plan:\n    def step(self, frame):\n        {body}\n")
        (tmp_path / f"{name}.colony").write_text(PROGRAM.replace("NAME", f"cli_{name}"))


KINDS = ["run", "test", "network", "clients", "python"]


@pytest.mark.usefixtures("modules")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["printing", "failing", "rubbish"])
def test_output_is_the_commands_own(colony: Colony, name: str, kind: str) -> None:
    code, out, err = colony(*command(name, kind), stdin='{"t": 0, "bumper": false}\n')
    assert code == 0
    json.loads(out)
    assert ("heard" in err) == (name == "printing")


@pytest.mark.usefixtures("modules")
@pytest.mark.parametrize("kind", KINDS)
def test_leaving_is_told(colony: Colony, kind: str) -> None:
    err = colony.refusal(*command("exiting", kind), stdin='{"t": 0, "bumper": false}\n', code=1)
    assert err.endswith("colony: error: a module in Python ended the process: SystemExit: 3\n")


@pytest.mark.usefixtures("modules")
def test_verdicts_come_before_a_module_that_leaves_when_it_is_imported(
    colony: Colony, tmp_path: Path
) -> None:
    (tmp_path / "cli_leaving.py").write_text("raise SystemExit(3)\n")
    file = tmp_path / "leaving.colony"
    file.write_text(
        PROGRAM.replace("NAME", "cli_leaving") + "contract still: drive is idle or plan is active\n"
    )
    code, out, err = colony("verify", "--examples", "3", file)
    assert code == 1
    assert f"{file}: proved   still  (without operators: --why still)\n" in out
    assert f"{file}:6:" in err
    assert "error[P001]: `cli_leaving:Plan` cannot be imported and built: SystemExit: 3" in err
