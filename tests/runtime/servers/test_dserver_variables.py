"""DServer's variables: values, histories, frames, limits, and who is told of changes."""

from __future__ import annotations

import math

import msgspec
import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.messages import Wake
from colony.runtime.servers.data_calls import LOST_WATCHES_NS
from colony.runtime.servers.variables import MAX_VALUE_BYTES, Variables, validate_value
from colony.runtime.store.store import Journal, MemoryStore
from tests.kit.data import DataStage
from tests.kit.node_stage import MS, Caller, CallError, S


def show(stage: DataStage, *names: str) -> None:
    """Have frames show these, for somebody who is there to see them."""
    stage.connect("observer/1").do(data.publish(names))


class Point(msgspec.Struct):
    x: float
    y: float


@pytest.mark.parametrize(
    "value",
    [
        4,
        -1.5,
        True,
        None,
        "goal",
        b"\x00\xff",
        [1, 2.5],
        {"a": [1, {"b": None}]},
        math.inf,
        2**64 - 1,
        -(2**63),
    ],
    ids=repr,
)
def test_what_was_set_is_got(ada: Caller, value: object) -> None:
    ada.do(data.set("PosX", value))
    assert ada.do(data.get("PosX")) == value


def test_a_value_is_got_as_the_type_that_is_asked_for(ada: Caller) -> None:
    ada.do(data.set("Goal", Point(1.0, 2.0)))
    assert ada.do(data.get("Goal", type=Point)) == Point(1.0, 2.0)
    with pytest.raises(msgspec.ValidationError):
        ada.do(data.get("Goal", type=int))


def test_a_value_that_msgpack_cannot_hold_is_told_before_it_is_sent() -> None:
    with pytest.raises(TypeError):
        data.set("PosX", object())
    with pytest.raises(OverflowError):
        data.set("PosX", 2**64)


def test_history_goes_back_as_far_as_it_is_long(ada: Caller) -> None:
    ada.do(data.set_history("PosX", 3))
    assert ada.refusal(data.get("PosX")) == "unset"
    for x in range(5):
        ada.do(data.set("PosX", x))
    assert [ada.do(data.get("PosX", back)) for back in (0, -1, -2)] == [4, 3, 2]
    assert ada.refusal(data.get("PosX", -3)) == "range"
    assert ada.refusal(data.get("PosX", 1)) == "range"
    assert [d.read(int) for d in ada.do(data.history("PosX"))] == [4, 3, 2]


def test_a_history_is_one_long_unless_told(ada: Caller) -> None:
    ada.do(data.set("PosX", 1))
    ada.do(data.set("PosX", 2))
    assert ada.do(data.get("PosX")) == 2
    assert ada.refusal(data.get("PosX", -1)) == "range"


def test_a_value_not_set_yet_is_told_apart_from_one_outside_the_history(ada: Caller) -> None:
    ada.do(data.set_history("PosX", 3))
    ada.do(data.set("PosX", 1))
    assert ada.refusal(data.get("PosX", -1)) == "unset"
    assert ada.refusal(data.get("PosY")) == "unknown"
    assert ada.refusal(data.history("PosY")) == "unknown"


def test_shrinking_drops_the_oldest_and_growing_keeps_all(ada: Caller) -> None:
    ada.do(data.set_history("PosX", 4))
    for x in range(6):
        ada.do(data.set("PosX", x))
    for length, kept in ((2, [5, 4]), (5, [5, 4])):
        ada.do(data.set_history("PosX", length))
        assert [d.read() for d in ada.do(data.history("PosX"))] == kept
        ada.stage.kill_and_restart()
        ada.open()
        assert [d.read() for d in ada.do(data.history("PosX"))] == kept
    for x in range(6, 12):
        ada.do(data.set("PosX", x))
    ada.stage.kill_and_restart()
    ada.open()
    assert [d.read() for d in ada.do(data.history("PosX"))] == [11, 10, 9, 8, 7]


@pytest.mark.parametrize("length", [0, -1, 10_001])
def test_impossible_histories_are_refused(ada: Caller, length: int) -> None:
    assert ada.refusal(data.set_history("PosX", length)) == "arguments"


def test_several_are_set_and_got_at_one_moment(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set_many({"X": 1, "Y": 2.5}))
    assert ada.do(data.get_many(["X", "Y"])) == {"X": 1, "Y": 2.5}
    times = {d.t_ns for name in "XY" for d in ada.do(data.history(name))}
    assert times == {stage.now_ns}
    assert ada.refusal(data.get_many(["X", "Z"])) == "unknown"


def test_where_one_of_several_cannot_be_set_none_is(ada: Caller) -> None:
    ada.do(data.set("X", 1))
    for bad in ({"X": 2, "": 3}, {"X": 2, "Y": b"a" * MAX_VALUE_BYTES}):
        with pytest.raises(CallError):
            ada.do(data.set_many(bad))
        assert ada.do(data.get("X")) == 1
        assert ada.do(data.names()) == ("X",)


@pytest.mark.parametrize(("name", "ok"), [("a", True), ("é" * 127, True), ("a" * 255, True), ("", False)])
def test_names_have_1_to_255_bytes(ada: Caller, name: str, ok: bool) -> None:
    if ok:
        ada.do(data.set(name, 1))
        assert ada.do(data.get(name)) == 1
    else:
        assert ada.refusal(data.set(name, 1)) == "arguments"
    assert ada.refusal(data.set(name + "é" * 128, 1)) == "arguments"
    assert ada.refusal(data.create_semaphore(name + "é" * 128)) == "arguments"


def test_a_value_that_is_too_large_is_refused(ada: Caller) -> None:
    ada.do(data.set("Big", b"a" * (MAX_VALUE_BYTES - 5)))
    assert ada.refusal(data.set("Big", b"a" * MAX_VALUE_BYTES)) == "size"
    assert len(ada.do(data.get("Big", type=bytes))) == MAX_VALUE_BYTES - 5


def test_a_reply_that_would_be_too_large_is_refused(ada: Caller) -> None:
    for i in range(4):
        ada.do(data.set(f"Big{i}", b"a" * (MAX_VALUE_BYTES - 5)))
    assert ada.refusal(data.get_many([f"Big{i}" for i in range(4)])) == "size"


@pytest.mark.parametrize(
    "raw", [b"\xa1\xff", b"\x81\x81\x01\x02\x03", b"\x91" * 2000 + b"\xc0"], ids=["utf", "map", "deep"]
)
def test_what_nobody_could_read_is_refused(ada: Caller, raw: bytes) -> None:
    """Text that is no UTF-8, a mapping with a mapping as key, and what is nested too deep."""
    ask = CallRequest("set", data.Set(name="X", value=msgspec.Raw(raw)), type(None), "command")
    assert ada.refusal(ask) == "arguments"
    assert ada.do(data.names()) == ()


def test_there_is_an_end_to_the_room() -> None:
    variables = Variables(Journal(MemoryStore()), space=12_000, frame_space=1_000)

    def put(name: str, value: object) -> None:
        variables.set((validate_value(name, msgspec.msgpack.encode(value)),), 0)

    put("a", b"a" * 8_000)
    with pytest.raises(RefusedError, match="no room"):
        put("b", b"b" * 3_900)
    put("a", b"a" * 8_500)
    variables.delete("a")
    put("b", b"b" * 9_000)
    put("c", [0.5] * 200)
    variables.delete("c")
    variables.set_program_names(["c"])
    variables.show(["c"])
    with pytest.raises(RefusedError, match="frames"):
        put("c", [0.5] * 200)
    put("c", [0.5] * 50)
    assert [*variables.fields(0)] == ["c"]
    variables.set_history("c", 5)
    with pytest.raises(RefusedError, match="no room"):
        variables.set_history("d" * 3_000, 1)


def test_delete_and_names(ada: Caller) -> None:
    for name in ("b", "a2", "a1", "c"):
        ada.do(data.set(name, 1))
    assert ada.do(data.names()) == ("a1", "a2", "b", "c")
    assert ada.do(data.names("a", limit=1)) == ("a1",)
    assert ada.do(data.names(after="a2")) == ("b", "c")
    assert ada.refusal(data.names(limit=0)) == "arguments"
    assert ada.do(data.delete("b"))
    assert not ada.do(data.delete("b"))
    assert ada.refusal(data.get("b")) == "unknown"
    ada.stage.kill_and_restart()
    ada.open()
    assert ada.do(data.names()) == ("a1", "a2", "c")


# --- frames --------------------------------------------------------------------------------------


def test_frames_show_numbers_bools_and_flat_lists_of_them(stage: DataStage, ada: Caller) -> None:
    values = {"i": 3, "f": 2.5, "b": True, "l": [1, 2.5, True]}
    others = {"s": "text", "n": None, "e": [], "deep": [[1]], "m": {"a": 1}, "t": [1, "a"]}
    ada.do(data.set_many(values | others))
    assert stage.fields(0) == {}
    ada.do(data.publish([*values, *others]))
    fields = stage.fields(1)
    assert fields == {"i": 3.0, "f": 2.5, "b": True, "l": (1.0, 2.5, True)}
    assert type(fields["i"]) is float
    assert fields["l"][2] is True


def test_a_frame_has_when_a_value_was_set_and_changes_with_it(stage: DataStage, ada: Caller) -> None:
    ada.do(data.publish(["X"]))
    assert stage.fields(0) == {}
    ada.do(data.set("X", 1))
    set_at = stage.now_ns
    stage.now_ns += 50 * MS
    sample = stage.frame(1).fields["X"]
    assert sample.t_ns == set_at
    ada.do(data.set("X", "gone"))
    assert stage.fields(2) == {}
    ada.do(data.set("X", 2))
    assert stage.fields(3) == {"X": 2.0}
    ada.do(data.delete("X"))
    assert stage.fields(4) == {}


def test_held_variables_are_fresh_until_they_are_set() -> None:
    stage = DataStage(pinned_variables={"Goal": (1.0, 2.0)})
    ada = stage.connect()
    ada.do(data.publish(["Goal"]))
    stage.now_ns += S
    sample = stage.frame(1).fields["Goal"]
    assert sample is not None
    assert sample == ((1.0, 2.0), stage.now_ns)
    assert ada.do(data.get("Goal")) == [1.0, 2.0]
    ada.do(data.set("Goal", 5))
    set_at = stage.now_ns
    stage.now_ns += S
    assert stage.frame(2).fields["Goal"] == (5.0, set_at)


def test_what_replaced_a_held_variable_survives_a_death_but_not_an_end() -> None:
    stage = DataStage(pinned_variables={"Goal": 1.0, "Other": 2.0})
    ada = stage.connect()
    ada.do(data.set("Goal", 5.0))
    stage.kill_and_restart()
    stage.now_ns += S
    show(stage, "Goal", "Other")
    assert stage.frame(1).fields == {"Goal": (5.0, stage.now_ns - S), "Other": (2.0, stage.now_ns)}
    stage.node.close()
    stage.options = {"pinned_variables": {"Goal": 3.0}}
    stage.kill_and_restart()
    show(stage, "Goal", "Other")
    assert stage.frame(2).fields == {"Goal": (3.0, stage.now_ns), "Other": (2.0, 0)}


def test_values_of_another_clock_are_old(stage: DataStage) -> None:
    """Variables outlive the robot's clock; a sensor with `within` must not take them for fresh."""
    stage = DataStage(clock_id="boot 1")
    stage.connect().do(data.set("X", 1))
    stage.kill_and_restart()
    show(stage, "X")
    assert stage.frame(1).fields["X"] == (1.0, stage.now_ns)
    for clock_id, now in (("boot 2", 2 * S), ("boot 2", 3 * S)):
        stage.options, stage.now_ns = {"clock_id": clock_id}, now
        stage.kill_and_restart()
        show(stage, "X")
        sample = stage.frame(2).fields["X"]
        assert sample.value == 1.0
        assert stage.now_ns - sample.t_ns > 10**16
    stage.connect().do(data.set("X", 2))
    stage.now_ns = S
    stage.kill_and_restart()
    show(stage, "X")
    sample = stage.frame(3).fields["X"]
    assert stage.now_ns - sample.t_ns > 10**16


# --- who is told of changes ----------------------------------------------------------------------


def test_who_watches_is_told_the_present_value_and_every_change(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.set("X", 1))
    assert ada.changes(ada.begin(data.watch("X", "Y"))) == [("X", 1)]
    assert ada.changes(bob.begin(data.set("X", 1))) == [("X", 1)]
    assert ada.changes(bob.begin(data.set_many({"Y": 3, "X": 2, "Z": 9}))) == [("Y", 3), ("X", 2)]
    assert ada.changes(bob.begin(data.delete("X"))) == [("X", ...)]
    assert ada.changes(bob.begin(data.delete("X"))) == []
    ada.do(data.unwatch("X"))
    assert ada.changes(bob.begin(data.set_many({"Y": 3, "X": 2}))) == [("Y", 3)]
    ada.do(data.unwatch())
    assert ada.changes(bob.begin(data.set("Y", 4))) == []


def test_a_prefix_watches_variables_that_are_still_to_come(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set_many({"Goal.x": 1, "Other": 2}))
    assert ada.changes(ada.begin(data.watch("Goal.x", prefixes=["Goal."]))) == [("Goal.x", 1)]
    assert ada.changes(ada.begin(data.set_many({"Goal.y": 5, "Goal.x": 6, "Goa": 7}))) == [
        ("Goal.y", 5),
        ("Goal.x", 6),
    ]
    assert ada.changes(ada.begin(data.watch(prefixes=[""]))) != []
    assert ada.changes(ada.begin(data.set("Any", 1))) == [("Any", 1)]


def test_watching_goes_on_after_a_restart_and_after_a_lost_connection(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.watch("X", prefixes=["Y"]))
    bob.do(data.set("X", 1))
    stage.kill_and_restart()
    bob.open()
    bob.do(data.set("X", 2))
    assert ada.changes(ada.open()) == [("X", 2)]
    assert ada.changes(bob.begin(data.set("Y1", 3))) == [("Y1", 3)]
    stage.pass_time(S, alive=(bob,))
    assert ada.changes(bob.begin(data.set("X", 4))) == []
    assert ada.changes(ada.open()) == [("X", 4), ("Y1", 3)]


def test_what_is_watched_is_forgotten_in_the_end(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set("X", 1))
    ada.do(data.watch("X"))
    ada.close()
    stage.now_ns += LOST_WATCHES_NS
    stage.handle(Wake())
    assert ada.changes(ada.open()) == []


def test_one_connection_cannot_watch_without_end(ada: Caller) -> None:
    for begin in (0, 1000):
        ada.do(data.watch(*(f"V{i}" for i in range(begin, begin + 1000))))
    assert ada.refusal(data.watch("one more")) == "full"
    ada.do(data.watch("V1"))
    assert ada.refusal(data.watch("a" * 256)) == "arguments"
