"""PServer: both rings in every frame and by calls, and how far the sonars look."""

from __future__ import annotations

import math

import pytest

from colony.runtime.library import proximity
from colony.runtime.protocol.messages import Malformed, Sample, ServerFrame, Tick
from colony.runtime.servers.pserver import PServer
from tests.kit.node_stage import Caller, NodeStage
from tests.robot_servers import ROME_SERVERS

RANGES = tuple(500.0 + 100.0 * sensor for sensor in range(24))
SEEN = tuple(sensor in (11, 12, 13) for sensor in range(24))


class Rings:
    """A device that reads the same until it is told to read nothing."""

    count = 24

    def __init__(self) -> None:
        self.mute = False

    def sonar(self) -> Sample | None:
        return None if self.mute else Sample(RANGES, 7)

    def infrared(self) -> Sample | None:
        return None if self.mute else Sample(SEEN, 8)


def caller(rings: Rings | None = None) -> Caller:
    return NodeStage(PServer(rings or Rings(), frames_kept=4)).connect()


def frame_of(ada: Caller) -> ServerFrame:
    return ada.stage.server_frame(Tick(k=0, t_ns=0))


def test_frames_have_both_rings_with_their_times() -> None:
    fields = frame_of(caller()).fields
    assert fields == {"sonar": Sample(RANGES, 7), "infrared": Sample(SEEN, 8)}
    [server] = [s for s in ROME_SERVERS if s.name == "PServer"]
    assert set(fields) == {field.name for field in server.fields}


def test_calls_give_what_the_device_reads_now() -> None:
    ada = caller()
    assert ada.do(proximity.sonar()) == proximity.SonarReading(t_ns=7, ranges=RANGES)
    assert ada.do(proximity.infrared()) == proximity.InfraredReading(t_ns=8, seen=SEEN)


def test_a_device_that_is_gone_has_no_value() -> None:
    rings = Rings()
    ada = caller(rings)
    rings.mute = True
    assert ada.do(proximity.sonar()) is None
    assert ada.do(proximity.infrared()) is None
    assert frame_of(ada).fields == {"sonar": None, "infrared": None}


def test_beyond_its_time_out_a_sonar_reads_just_that() -> None:
    ada = caller()
    assert ada.do(proximity.timeouts()) is None
    most = tuple(1000.0 if sensor < 12 else 5000.0 for sensor in range(24))
    ada.do(proximity.set_timeouts(most))
    assert ada.do(proximity.timeouts()) == most
    cut = tuple(map(min, RANGES, most))
    assert cut != RANGES
    reading = ada.do(proximity.sonar())
    assert reading.ranges == cut
    assert frame_of(ada).fields["sonar"] == Sample(cut, 7)


@pytest.mark.parametrize(
    ("ranges", "found"),
    [
        ([1000.0] * 23, "23 ranges; expected 24"),
        ([], "0 ranges"),
        ([1000.0] * 23 + [0.0], "sensor 23: 0.0 mm"),
        ([-5.0] + [1000.0] * 23, "sensor 0: -5.0 mm"),
        ([math.nan] * 24, "sensor 0: nan mm"),
        ([math.inf] * 24, "sensor 0: inf mm"),
    ],
)
def test_time_outs_that_make_no_sense_change_nothing(ranges: list[float], found: str) -> None:
    ada = caller()
    problem = ada.problem(proximity.set_timeouts(ranges))
    assert problem.code == "arguments"
    assert found in problem.message
    assert ada.do(proximity.timeouts()) is None


def test_whoever_may_only_read_sets_no_time_outs() -> None:
    ada = caller()
    assert ada.refusal(proximity.set_timeouts([1000.0] * 24)._replace(right="read")) == "right"


def test_what_cannot_be_read_is_answered() -> None:
    ada = caller()
    assert len(ada.stage.handle(Malformed(topic="t", connection=ada.name, reason="odd"))) == 1
    assert ada.stage.handle(Malformed(topic="t", connection=None, reason="odd")) == []
