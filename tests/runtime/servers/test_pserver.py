"""PServer: both rings in every frame and by calls, and how far the sonars look."""

from __future__ import annotations

import math

import pytest

from colony.runtime.library import proximity
from colony.runtime.protocol.messages import Malformed, Sample, Send, ServerFrame, Tick
from colony.runtime.servers.pserver import PServer
from tests.robot_servers import ROME_SERVERS
from tests.runtime.asking import Asker, TroubleError

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


def asker(rings: Rings | None = None) -> Asker:
    one = Asker(PServer(rings or Rings(), frames_kept=4))
    one.open("ann")
    return one


def frame_of(one: Asker, k: int = 0) -> ServerFrame:
    (message,) = (e.message for e in one.server.handle(Tick(k=k, t_ns=k), k) if isinstance(e, Send))
    assert isinstance(message, ServerFrame)
    return message


def test_frames_have_both_rings_with_their_times() -> None:
    fields = frame_of(asker()).fields
    assert fields == {"sonar": Sample(RANGES, 7), "infrared": Sample(SEEN, 8)}
    [server] = [s for s in ROME_SERVERS if s.name == "PServer"]
    assert set(fields) == {field.name for field in server.fields}


def test_calls_give_what_the_device_reads_now() -> None:
    one = asker()
    assert one.do("ann", proximity.sonar()) == proximity.SonarReading(t_ns=7, ranges=RANGES)
    assert one.do("ann", proximity.infrared()) == proximity.InfraredReading(t_ns=8, seen=SEEN)


def test_a_device_that_is_gone_has_no_value() -> None:
    rings = Rings()
    one = asker(rings)
    rings.mute = True
    assert one.do("ann", proximity.sonar()) is None
    assert one.do("ann", proximity.infrared()) is None
    assert frame_of(one).fields == {"sonar": None, "infrared": None}


def test_beyond_its_time_out_a_sonar_reads_just_that() -> None:
    one = asker()
    assert one.do("ann", proximity.timeouts()) is None
    most = tuple(1000.0 if sensor < 12 else 5000.0 for sensor in range(24))
    one.do("ann", proximity.set_timeouts(most))
    assert one.do("ann", proximity.timeouts()) == most
    cut = tuple(map(min, RANGES, most))
    assert cut != RANGES
    reading = one.do("ann", proximity.sonar())
    assert reading is not None
    assert reading.ranges == cut
    assert frame_of(one).fields["sonar"] == Sample(cut, 7)


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
    one = asker()
    with pytest.raises(TroubleError, match=found) as trouble:
        one.do("ann", proximity.set_timeouts(ranges))
    assert trouble.value.code == "arguments"
    assert one.do("ann", proximity.timeouts()) is None


def test_whoever_may_only_read_sets_no_time_outs() -> None:
    one = asker()
    with pytest.raises(TroubleError) as trouble:
        one.do("ann", proximity.set_timeouts([1000.0] * 24)._replace(right="read"))
    assert trouble.value.code == "right"


def test_what_cannot_be_read_is_answered() -> None:
    one = asker()
    effects = list(one.server.handle(Malformed(topic="t", connection="user/ann", reason="odd"), 0))
    assert len(effects) == 1
    assert list(one.server.handle(Malformed(topic="t", connection=None, reason="odd"), 0)) == []
