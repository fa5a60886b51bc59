"""The behaviors of an experiment are those that it began with."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.experiment.design import ProgramChoice, compiled_of, sources_digest
from colony.runs.spec import MisuseError

BEHAVIOR = """
language 1
robot r {
  frame 100 ms
  sensor s: number from X.s
  actuator a { v: number } to X.a idle a(v = 0)
}
param p = 1
module m { when s > p do a(v = 1) }
network { a = m }
"""


def test_behavior_that_changes_during_an_experiment_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "b.colony"
    file.write_text(BEHAVIOR)
    free = ProgramChoice("b", str(file), None, None)
    begun = free._replace(sources=sources_digest(compiled_of(free).compiled))
    assert compiled_of(begun, (("p", "2"),)).program.robot.name == "r"
    file.write_text(BEHAVIOR + "# changed")
    with pytest.raises(MisuseError, match=r"b\.colony has changed since the experiment began"):
        compiled_of(begun, (("p", "3"),))
