"""What `colony shadow` prints: a line when the winner changes, and one a second."""

from __future__ import annotations

from collections.abc import Mapping

from colony.cli.shadow import Decisions
from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.ir.types import ScalarValue
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.protocol.messages import Tick, Verdict

MS = 1_000_000
ROBOT = """language 1
robot r {
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
  actuator hitch { position : place, lamp : bool } to Hitch.move idle hold
}
enum place { open = 0, closed = 1 }
module go { when true  do drive(velocity = 1 mm/s, turn = 0) }
network { drive = go }
"""

NO_CONTROLLER: Mapping[str, HeardCommand | None] = {}
HOLD: tuple[ScalarValue, ...] | None = None


class Shown:
    def __init__(self) -> None:
        self.lines: list[str] = []
        actuators = load_text(ROBOT, "r.colony").robot.actuators
        self._decisions = Decisions(actuators, self.lines.append)

    def frame(
        self,
        t_ms: int,
        by: str | None,
        velocity: float,
        hitch: object = HOLD,
        fault: str = "",
        heard: Mapping[str, HeardCommand | None] = NO_CONTROLLER,
    ) -> None:
        verdicts = {
            "drive": _verdict(t_ms, "drive", by, (velocity, -0.0), fault or None),
            "hitch": _verdict(t_ms, "hitch", None if hitch is None else "close", hitch),
        }
        tick = Tick(k=t_ms, t_ns=t_ms * MS)
        self._decisions.take(
            RunFrame(
                tick=tick,
                frame=Frame(tick.t_ns, {}),
                verdicts=verdicts,
                heard=heard,
            )
        )


def _verdict(t_ms: int, actuator: str, by: str | None, values: object, fault: str | None = None) -> Verdict:
    return Verdict(
        k=t_ms,
        t_ns=t_ms * MS,
        actuator=actuator,
        by=by,
        values=values,  # type: ignore[arg-type]
        fates=(),
        fault=fault,
    )


def test_a_line_a_second_and_one_for_each_change_of_the_winner() -> None:
    shown = Shown()
    for t_ms in range(0, 2050, 50):
        shown.frame(t_ms, "go" if t_ms < 1500 else None, float(t_ms))
    assert [line.split(" s ")[0].strip() for line in shown.lines] == ["0.00", "1.00", "1.50"]


def test_what_would_be_sent() -> None:
    shown = Shown()
    shown.frame(0, "go", 333.333)
    shown.frame(50, None, -0.0, hitch=(1.0, True))
    shown.frame(100, "go", 0.0, hitch=(0.0, False), fault="missing")
    assert shown.lines == [
        "    0.00 s  would send drive(velocity = 333.3 mm/s, turn = 0 deg/s) by go; nothing to hitch",
        "    0.05 s  would send drive(velocity = 0 mm/s, turn = 0 deg/s) by nobody; "
        "hitch(position = closed, lamp = true) by close",
        "    0.10 s  would send drive(velocity = 0 mm/s, turn = 0 deg/s) by go (missing); "
        "hitch(position = open, lamp = false) by close",
    ]


def test_what_another_controller_commands_is_beside_it() -> None:
    shown = Shown()
    shown.frame(0, "go", 1.0, heard={"drive": HeardCommand((2.5, 0.0), 31_000_000)})
    shown.frame(1000, "go", 1.0, heard={"drive": None})
    ours = "drive(velocity = 1 mm/s, turn = 0 deg/s) by go; nothing to hitch"
    would = f"would send {ours}; the controller commanded"
    assert shown.lines == [
        f"    0.00 s  {would} drive(velocity = 2.5 mm/s, turn = 0 deg/s), 31 ms before the frame",
        f"    1.00 s  {would} no drive",
    ]
