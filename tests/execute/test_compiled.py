"""What a compiled program says of its robot and its clients."""

from __future__ import annotations

from colony.compile.lower.lower import lower
from tests.programs import compilation, robot

TEXT = f"""{robot()}
module m {{ when a do out(v = 1) }}
module n {{ when b do out(v = 2) }}
network {{ out = m suppresses n }}
"""


def test_the_robot_is_that_of_the_program() -> None:
    of = compilation(TEXT)
    assert of.compiled.robot == of.program.robot
    assert of.compiled.clients == (("out", "m", 2), ("out", "n", 1))


def test_code_that_was_lowered_alone_has_no_sources() -> None:
    of = compilation(TEXT)
    alone = lower(of.program, of.clients, of.traversal)
    assert (alone.sources, alone.root) == ((), "")
