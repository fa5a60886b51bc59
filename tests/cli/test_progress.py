"""The progress that a run reports where there is no terminal."""

from __future__ import annotations

import pytest

from colony.cli.progress import RunProgress
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Tick, Verdict

SECOND = 1_000_000_000


def frame(t_s: int, **by: str | None) -> RunFrame:
    verdicts = {
        name: Verdict(k=t_s, t_ns=t_s * SECOND, actuator=name, by=winner, values=None, fates=())
        for name, winner in by.items()
    }
    tick = Tick(k=t_s, t_ns=t_s * SECOND)
    return RunFrame(
        tick=tick,
        frame=Frame(tick.t_ns, {}),
        verdicts=verdicts,
    )


def test_actuators_are_in_one_order_whatever_that_of_their_verdicts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    progress = RunProgress(10 * SECOND)
    progress.take(frame(1, lift=None, drive="cruise"))
    progress.take(frame(2, drive="cruise", lift=None))
    progress.close()
    assert capsys.readouterr().err == (
        "10 %: 1.0 s, drive by cruise, lift by nobody\n20 %: 2.0 s, drive by cruise, lift by nobody\n"
    )
