"""Frames are put together whatever the order of arrival, and only an explicit absence is missing."""

from __future__ import annotations

import itertools

from colony.ir.frame import Frame
from colony.runtime.assembly import FrameAssembler
from colony.runtime.bindings import SensorBinding
from colony.runtime.messages import Fetch, Sample, Send, ServerFrame, Tick

MS = 1_000_000
SONAR = SensorBinding(sensor="sonar", server="P", field="sonar", within_ns=300 * MS, factor=1.0)
BUMPER = SensorBinding(sensor="bumper", server="R", field="bumper", within_ns=None, factor=1.0)
METERS = SensorBinding(sensor="m", server="P", field="sonar", within_ns=None, factor=1000.0)


def tick(k: int, **more: tuple[str, ...]) -> Tick:
    return Tick(k=k, t_ns=k * 50 * MS, **more)


def proximity(k: int, value: tuple[float, ...] = (1.0, 2.0), t_ns: int | None = None) -> ServerFrame:
    return ServerFrame(
        server="P", k=k, fields={"sonar": Sample(value, k * 50 * MS if t_ns is None else t_ns)}
    )


def base(k: int, bumper: bool = False) -> ServerFrame:
    return ServerFrame(server="R", k=k, fields={"bumper": Sample(bumper, k * 50 * MS)})


def frames(assembler: FrameAssembler, *messages: Tick | ServerFrame) -> list[Frame]:
    out = []
    for message in messages:
        assembler.take(message)
        out += [a.frame for a in assembler.complete()]
    return out


def test_any_order_and_doubled_messages_give_the_same_frames() -> None:
    messages: tuple[Tick | ServerFrame, ...] = (
        tick(0),
        proximity(0),
        base(0),
        tick(1),
        proximity(1),
        base(1, True),
    )
    expected = [
        Frame(0, {"sonar": (1.0, 2.0), "bumper": False}),
        Frame(50 * MS, {"sonar": (1.0, 2.0), "bumper": True}),
    ]
    for order in itertools.permutations(messages):
        assert frames(FrameAssembler((SONAR, BUMPER)), *order, *order) == expected


def test_a_value_older_than_within_is_missing_and_one_just_as_old_is_not() -> None:
    binding = (SONAR,)
    assert frames(FrameAssembler(binding), tick(0), proximity(0, t_ns=-300 * MS))[0].readings
    assert not frames(FrameAssembler(binding), tick(0), proximity(0, t_ns=-300 * MS - 1))[0].readings


def test_no_value_is_missing() -> None:
    silent = ServerFrame(server="P", k=0, fields={"sonar": None})
    assert frames(FrameAssembler((SONAR,)), tick(0), silent) == [Frame(0, {})]
    nothing = ServerFrame(server="P", k=0, fields={})
    assert frames(FrameAssembler((SONAR,)), tick(0), nothing) == [Frame(0, {})]


def test_a_frame_not_delivered_is_no_missing_sensor_but_is_fetched() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, tick(0), base(0)) == []
    assert assembler.take(tick(1)) == (Send("P/fetches", Fetch(server="P", k=0)),)
    assert frames(assembler, base(1), proximity(1)) == []
    assert [f.t_ns for f in frames(assembler, proximity(0))] == [0, 50 * MS]


def test_a_tick_not_delivered_is_fetched() -> None:
    assembler = FrameAssembler((BUMPER,))
    assembler.take(base(0))
    assert assembler.take(tick(1)) == (Send("Clock/fetches", Fetch(server="Clock", k=0)),)


def test_only_the_newest_frame_is_current() -> None:
    assembler = FrameAssembler((BUMPER,))
    for message in (tick(0), tick(1), base(1), base(0)):
        assembler.take(message)
    assert [a.current for a in assembler.complete()] == [False, True]


def test_the_sensors_of_a_server_that_is_down_are_missing_even_if_its_frame_comes() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, base(0), tick(0, down=("P",))) == [Frame(0, {"bumper": False})]
    assert frames(assembler, proximity(1), base(1), tick(1, down=("P",))) == [
        Frame(50 * MS, {"bumper": False})
    ]


def test_frames_that_a_dead_server_did_not_give_are_given_up_when_a_tick_says_so() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, tick(0), base(0), tick(1), base(1)) == []
    got = frames(assembler, base(2), tick(2, down=("P",)))
    assert [f.readings for f in got] == [{"bumper": False}] * 3


def test_values_enter_in_the_declared_unit() -> None:
    (frame,) = frames(FrameAssembler((METERS,)), tick(0), proximity(0, (1500.0, 250.0)))
    assert frame.readings == {"m": (1.5, 0.25)}


def test_without_sensors_every_tick_is_a_frame() -> None:
    assert frames(FrameAssembler(()), tick(0), tick(1)) == [Frame(0, {}), Frame(50 * MS, {})]
