"""Limits of one call to DServer and of all together; notices to connections that watch come in slices."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Wake, WakeAt
from colony.runtime.servers import call_answers, data_calls, semaphores, variables
from colony.runtime.servers.call_answers import CallAnswers
from colony.runtime.servers.data_calls import SLICE_BYTES, SLICE_INTERVAL_NS, SLICE_NOTICES
from colony.runtime.servers.variables import SortedNames
from colony.runtime.store.store import Journal, MemoryStore
from tests.kit.data import DataStage
from tests.kit.node_stage import Caller, settle

# --- one call ------------------------------------------------------------------------------------


def test_a_call_is_of_a_thousand_names_at_most(ada: Caller) -> None:
    names = [f"V{i}" for i in range(1000)]
    ada.do(data.set_many(dict.fromkeys(names, 1)))
    assert len(ada.do(data.get_many(names))) == 1000
    ada.do(data.watch(*names[:950], prefixes=names[950:]))
    assert ada.refusal(data.watch(prefixes=["one more"])) == "full"
    ada.do(data.unwatch(*names))
    more = [*names, "one more"]
    for ask in (
        data.set_many(dict.fromkeys(more, 1)),
        data.get_many(more),
        data.watch(*more),
        data.watch(*names, prefixes=["one more"]),
        data.unwatch(*more),
    ):
        assert ada.refusal(ask) == "size"
    assert ada.do(data.names("one")) == ()


@pytest.mark.parametrize(
    "values", [b"\xde\xff\xff" + b"\xa1a\x90" * 0xFFFF, b"\xdf\x00\x07\xff\xff" + b"\xa0\xc0" * 0x7FFFF]
)
def test_values_are_counted_not_only_measured(ada: Caller, values: bytes) -> None:
    """Of one name each, again and again: decoded they would be one value."""
    assert (
        ada.refusal(CallRequest("set_many", data.SetMany(values=msgspec.Raw(values)), type(None), "command"))
        == "size"
    )


@pytest.mark.parametrize("values", [b"\x90", b"\xc0", b"\x81\x01\x02", b"\x81\xa1\xff\x02"])
def test_what_is_no_mapping_of_names_is_refused(ada: Caller, values: bytes) -> None:
    ask = CallRequest("set_many", data.SetMany(values=msgspec.Raw(values)), type(None), "command")
    assert ada.refusal(ask) == "arguments"


def test_values_of_more_than_a_megabyte_are_refused_together(ada: Caller) -> None:
    ada.do(data.set_many({"A": b"a" * 500_000, "B": b"b" * 500_000}))
    assert ada.refusal(data.set_many({"A": b"c" * 600_000, "B": b"c" * 600_000})) == "size"
    assert ada.do(data.get("A", type=bytes))[:1] == b"a"


def test_a_long_history_comes_in_parts(ada: Caller) -> None:
    ada.do(data.set_history("X", 2500))
    for x in range(2500):
        ada.do(data.set("X", x))
    first = ada.do(data.history("X"))
    rest = ada.do(data.history("X", -len(first)))
    assert (len(first), len(rest)) == (2000, 500)
    assert [d.read() for d in (*first, *rest)] == list(range(2499, -1, -1))
    assert [d.read() for d in ada.do(data.history("X", -1, 2))] == [2498, 2497]
    assert ada.do(data.history("X", -2500)) == ()
    for ask in (data.history("X", 1), data.history("X", 0, 0), data.history("X", 0, 2001)):
        assert ada.refusal(ask) == "arguments"


# --- all of them ---------------------------------------------------------------------------------


def test_there_are_so_many_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variables, "MAX_VARIABLES", 3)
    stage = DataStage()
    ada = stage.connect()
    ada.do(data.set_many({"A": 1, "B": 2}))
    assert ada.refusal(data.set_many({"B": 3, "C": 3, "D": 4})) == "full"
    assert ada.do(data.get("B")) == 2
    ada.do(data.set_history("C", 5))
    assert stage.node.limit_messages() == ("variables: 3 of 3 are used, and there was no room for more",)
    for ask in (data.set("D", 1), data.set_history("D", 2)):
        assert ada.refusal(ask) == "full"
    ada.do(data.set("A", 5))
    ada.do(data.delete("A"))
    ada.do(data.set("D", 1))


def test_there_are_so_many_semaphores_holds_and_waiting_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MAX_SEMAPHORES", "MAX_HOLDS", "MAX_WAITING_CALLS"):
        monkeypatch.setattr(semaphores, name, 2)
    stage = DataStage()
    ada, bob = stage.connect(), stage.connect("bob/1")
    ada.do(data.create_semaphore("S", 5))
    ada.do(data.create_semaphore("T", 0))
    assert ada.refusal(data.create_semaphore("U", 1)) == "full"
    for _ in range(2):
        ada.do(data.wait("S", hold=True))
        bob.begin(data.wait("T"))
    assert ada.refusal(data.wait("S", hold=True)) == "full"
    assert ada.refusal(data.wait("T")) == "full"
    assert [said.split(":")[0] for said in stage.node.limit_messages()] == [
        "semaphores",
        "holds of semaphores",
        "calls that wait for semaphores",
    ]
    ada.do(data.wait("S"))
    assert ada.do(data.semaphore("S")).holding == ("ada/1", "ada/1")
    ada.close()
    bob.do(data.wait("S", hold=True))
    bob.do(data.delete_semaphore("S"))
    bob.do(data.create_semaphore("S", 1))
    assert bob.do(data.semaphore("S")).holding == ()


def test_there_are_so_many_names_and_prefixes_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_calls, "MAX_WATCHED_NAMES", 3)
    monkeypatch.setattr(data_calls, "MAX_WATCHED_PREFIXES", 2)
    monkeypatch.setattr(data_calls, "USER_LIMIT_DIVISOR", 1)
    stage = DataStage()
    ada, bob = stage.connect(), stage.connect("bob/1")
    ada.do(data.watch("A", "B", prefixes=["P"]))
    bob.do(data.watch("A", prefixes=["P"]))
    assert bob.refusal(data.watch("C")) == "full"
    assert bob.refusal(data.watch(prefixes=["Q"])) == "full"
    bob.do(data.watch("A", prefixes=["P"]))
    assert len(stage.node.limit_messages()) == 2
    ada.do(data.unwatch("B", prefixes=["P"]))
    bob.do(data.watch("C", prefixes=["Px"]))
    assert bob.changes(ada.begin(data.set("Pxy", 1))) == [("Pxy", 1)]


def test_no_user_watches_all_there_is_to_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_calls, "MAX_WATCHED_NAMES", 4)
    monkeypatch.setattr(data_calls, "MAX_WATCHED_PREFIXES", 4)
    stage = DataStage()
    first, second, bob = stage.connect("ada/1"), stage.connect("ada/2"), stage.connect("bob/1")
    first.do(data.watch("A", prefixes=["P"]))
    second.do(data.watch("B", prefixes=["Q"]))
    assert second.refusal(data.watch("C")) == "full"
    assert first.refusal(data.watch(prefixes=["R"])) == "full"
    bob.do(data.watch("C", "D", prefixes=["R", "S"]))


def test_answers_of_long_ago_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(call_answers, "MAX_TOTAL_BYTES", 10 * (call_answers.OVERHEAD + 10))
    store = MemoryStore()
    journal = Journal(store)
    answers = CallAnswers(journal)
    for i in range(20):
        answers.record(f"ada/{i}", 1, b"\xc0")
    settle(journal)
    loaded = CallAnswers(journal)
    loaded.load(dict(store.load()))
    for one in (answers, loaded):
        assert [i for i in range(20) if one.find(f"ada/{i}", 1) is not None] == list(range(10, 20))
    assert len(store.load()) == 10
    assert answers.limit_messages != ()
    assert loaded.limit_messages == ()


def test_names_are_found_in_order() -> None:
    names = SortedNames()
    for name in ("b", "a2", "a1", "é", "a", "b\U0010ffff", "c"):
        names.add(name)
    assert names.page("", "", 100) == ("a", "a1", "a2", "b", "b\U0010ffff", "c", "é")
    assert names.page("a", "", 2) == ("a", "a1")
    assert names.page("a", "a1", 5) == ("a2",)
    assert names.page("a", "b", 5) == ()
    assert list(names.with_prefixes(["b", "a1", "b\U0010ffff", "a1x"])) == ["a1", "b", "b\U0010ffff"]
    assert list(names.with_prefixes(["", "a"])) == list(names.page("", "", 100))
    names.discard("a1")
    names.update(["z", "d"])
    assert names.page("", "a", 3) == ("a2", "b", "b\U0010ffff")


# --- telling in slices ---------------------------------------------------------------------------


def told(stage: DataStage, ada: Caller) -> list[list[tuple[str, Any]]]:
    """What it is told in each of the slices that follow, until there is nothing more."""
    slices = []
    while True:
        stage.now_ns += SLICE_INTERVAL_NS
        changes = ada.changes(stage.handle(Wake()))
        if not changes:
            return slices
        slices.append(changes)


def test_thousands_of_present_values_are_told_in_slices(stage: DataStage, ada: Caller) -> None:
    names = [f"V{i:03}" for i in range(600)]
    ada.do(data.set_many(dict.fromkeys(names, 1)))
    first = ada.changes(ada.begin(data.watch(prefixes=["V"])))
    assert len(first) == SLICE_NOTICES
    second = ada.changes(ada.begin(data.set("V599", 2)))
    assert len(second) == SLICE_NOTICES
    rest = [change for part in told(stage, ada) for change in part]
    assert {name for name, _ in [*first, *second, *rest]} == set(names)
    assert dict(rest)["V599"] == 2
    assert ada.changes(ada.begin(data.set("V000", 3))) == [("V000", 3)]


def test_a_reopened_connection_is_told_in_slices_too(stage: DataStage, ada: Caller) -> None:
    names = [f"V{i:03}" for i in range(SLICE_NOTICES + 10)]
    ada.do(data.set_many(dict.fromkeys(names, 1)))
    ada.do(data.watch(prefixes=[""]))
    told(stage, ada)
    stage.kill_and_restart()
    first = ada.changes(ada.open())
    assert [name for name, _ in first] == names[:SLICE_NOTICES]
    assert [name for part in told(stage, ada) for name, _ in part] == names[SLICE_NOTICES:]


def test_large_values_are_told_a_few_at_a_time(stage: DataStage, ada: Caller) -> None:
    size = SLICE_BYTES // 4
    for i in range(10):
        ada.do(data.set(f"V{i}", b"a" * size))
    first = ada.changes(ada.begin(data.watch(prefixes=["V"])))
    assert 0 < len(first) <= 4
    assert sum(len(part) for part in told(stage, ada)) == 10 - len(first)


def test_everybody_who_watches_is_told_in_the_end(stage: DataStage) -> None:
    watchers = [stage.connect(f"ada/{i}") for i in range(SLICE_NOTICES + 20)]
    for watcher in watchers:
        watcher.do(data.watch("X"))
    bob = stage.connect("bob/1")
    begun = bob.begin(data.set("X", 1))
    assert sum(len(w.changes(begun)) for w in watchers) == SLICE_NOTICES
    stage.now_ns += SLICE_INTERVAL_NS
    later = stage.handle(Wake())
    assert [w.changes(begun + later) for w in watchers] == [[("X", 1)]] * len(watchers)
    begun = bob.begin(data.delete("X"))
    stage.now_ns += SLICE_INTERVAL_NS
    later = stage.handle(Wake())
    assert [w.changes(begun + later) for w in watchers] == [[("X", ...)]] * len(watchers)


def test_slices_are_asked_for_once(stage: DataStage, ada: Caller) -> None:
    """However many messages come meanwhile, one wake is due for the next slice."""
    ada.do(data.set_many({f"V{i:03}": 1 for i in range(900)}))
    effects = ada.begin(data.watch(prefixes=["V"]))
    for _ in range(2):
        effects += ada.begin(data.names())
    wakes = [e for e in effects if isinstance(e, WakeAt) and e.t_ns == stage.now_ns + SLICE_INTERVAL_NS]
    assert len(wakes) == 1
