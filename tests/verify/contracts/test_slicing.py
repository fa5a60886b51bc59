"""What contracts depend on."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved
from colony.verify.contracts.slicing import slice_of

TEXT = """language 1
robot r {
  sensor bumper : bool from RServer.bumper
  sensor level : number from PServer.level
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
let near = value_or(level, 0) > 3
module near { when value_or(bumper, false) do drive(velocity = 0) }
network { drive = near }
contract stands: drive.velocity == 0
contract about_level: near implies value_or(level, 0) > 3
"""


def test_a_module_named_like_a_value_is_told_from_it() -> None:
    program = load_text(TEXT)
    stands, about_level = program.contracts
    assert [s.name for s in slice_of(program, stands).robot.sensors] == ["bumper"]
    assert [s.name for s in slice_of(program, about_level).robot.sensors] == ["level"]
    assert not slice_of(program, about_level).modules
    assert all(isinstance(result, Proved) for result in prove_contracts(program))
