"""One text, followed from its file to one command: nothing on the way is done twice."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from colony.cli.programs import compile_file
from colony.compile import pipeline
from colony.execute import artifact
from colony.execute.compiled import Compiled
from colony.runtime.assembly.virtual import VirtualSession
from tests.runtime.scripted import Log, Script

TEXT = """
robot rome {
  sensor   bumper : bool  from RServer.bumper
  actuator drive { velocity : mm/s, turn : deg/s }  to RServer.drive  idle drive(velocity = 0, turn = 0)
}
module back_off { when bumper  do drive(velocity = -100 mm/s, turn = 0) }
module cruise   { when true    do drive(velocity = 200 mm/s, turn = 0) }
network { drive = back_off suppresses cruise }
"""

FRAME_NS = 50_000_000


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the calls of what must happen once."""
    calls: Counter[str] = Counter()

    def count(where: Any, name: str) -> None:
        original = getattr(where, name)

        def counting(*arguments: Any, **options: Any) -> Any:
            calls[name] += 1
            return original(*arguments, **options)

        monkeypatch.setattr(where, name, counting)

    for name in ("elaborate", "eliminate_inhibition", "forward_traversal", "simplify", "lower"):
        count(pipeline, name)
    return calls


def test_from_file_to_motor(counted: Counter[str], tmp_path: Path) -> None:
    path = tmp_path / "roam.colony"
    path.write_text(TEXT)
    data = artifact.encode(compile_file(str(path)).artifact)
    path.unlink()  # all that is needed is in the artifact
    compiled: Compiled = artifact.decode(data, "roam.colonyc")
    script, log = Script(), Log()
    session = VirtualSession(compiled, script.drivers, clock=script.clock, seed=1, sinks=(log,))
    session.run(FRAME_NS)
    assert log.winners() == ["cruise"]
    assert log.frames[0].verdicts["drive"].values == (200.0, 0.0)
    assert counted == dict.fromkeys(
        ("elaborate", "eliminate_inhibition", "forward_traversal", "simplify", "lower"), 1
    )
