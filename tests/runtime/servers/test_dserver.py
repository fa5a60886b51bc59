"""DServer as a node: actuators bound to it, deployments, checkpoints, and bytes that are no message."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from colony.ir.frame import Answer
from colony.runtime.library import data
from colony.runtime.library.ask import STATUS
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.messages import (
    Announcement,
    Effect,
    Fetch,
    Malformed,
    Recall,
    SendMessage,
    ServerFrame,
    Verdict,
    Wake,
)
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.sqlite import SqliteStore
from colony.runtime.store.store import Key, MemoryStore, StoreError
from tests.kit.data import DRIVE, LAMP, POSE, DataStage, checkpoint, field, program, request, table
from tests.kit.node_stage import Caller, S, messages


def verdicts(effects: list[Effect]) -> list[Verdict]:
    return messages(effects, Verdict)


def last(effects: list[Effect]) -> dict[str, object]:
    """What the frame among these effects says was sent before."""
    (frame,) = messages(effects, ServerFrame)
    fields = frame.fields
    return {name: sample and sample.value for name, sample in fields.items() if name.startswith("last.")}


def test_what_was_sent_survives_a_death_where_the_actuator_holds_it() -> None:
    held, quiet = structs.replace(LAMP, reported=(0,)), structs.replace(POSE, name="quiet")
    off = structs.replace(LAMP, name="off", command="Off", idle=(False,), reported=(0,))
    stage = DataStage()
    leader = stage.connect()
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(stage.tick(0)) == {}
    stage.handle(request(0, "lamp", True), request(0, "quiet", 1.0, 2.0), request(0, "off", True))
    assert last(stage.tick(1)) == {"last.lamp.on": True, "last.off.on": True}
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(stage.tick(2)) == {"last.lamp.on": True}
    stage.handle(request(2, "lamp", False))
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(stage.tick(3)) == {"last.lamp.on": False}
    leader.do(deploy(program("next", held, quiet, off)))
    assert last(stage.tick(4, "next")) == {}, "of another run"
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(stage.tick(5)) == {}


# --- deployments ---------------------------------------------------------------------------------


def test_what_a_command_of_a_frame_sets_is_read_in_the_next(stage: DataStage) -> None:
    leader = stage.connect("ada/leader")
    leader.do(deploy(program("run", LAMP, POSE, reads=("Lamp", "Pose"))))
    assert [e for e in stage.tick(7) if isinstance(e, SendMessage)] != []
    for command in (request(7, "lamp", True), request(7, "pose", 1.0, 2.5)):
        assert [v.by for v in verdicts(stage.handle(command))] == ["counter"]
    assert stage.fields(7 + 1, "run") == {"Lamp": True, "Pose": (1.0, 2.5)}
    assert leader.do(data.get("Pose")) == [1.0, 2.5]
    stage.kill_and_restart()
    leader.open()
    assert leader.do(data.get("Lamp")) is True


def test_who_watches_is_told_what_a_command_sets(stage: DataStage) -> None:
    leader = stage.connect("ada/leader")
    leader.do(deploy(program("run", LAMP)))
    leader.do(data.watch("Lamp"))
    stage.tick(1)
    assert leader.changes(stage.handle(request(1, "lamp", True))) == [("Lamp", True)]


def test_the_same_run_again_changes_nothing(stage: DataStage) -> None:
    leader = stage.connect()
    leader.do(deploy(program("run", LAMP)))
    stage.tick(1)
    leader.do(deploy(program("run", LAMP)))
    assert len(verdicts(stage.handle(request(1, "lamp", True)))) == 1


def test_in_frames_of_another_run_nothing_is_decided(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", LAMP)))
    stage.tick(1)
    effects = stage.tick(2, run="")
    assert [v.k for v in verdicts(effects)] == [1]
    assert verdicts(stage.handle(request(2, "lamp", True))) == []
    stage.now_ns += S
    assert verdicts(stage.handle(Wake()) + stage.tick(3, run="")) == []
    assert stage.fields(4) == {}


def test_activities_of_announced_modules_are_handed_on(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", python_modules=("pulse",))))
    (sent,) = stage.handle(Announcement(k=3, module="pulse", answer=Answer((300.0, 5.0))))
    assert sent.message.server == "DServer/activity/pulse"
    assert stage.handle(Fetch(server="DServer/activity/pulse", k=3)) == [sent]
    assert stage.handle(Announcement(k=3, module="stranger", answer=Answer((300.0, 5.0)))) == []


# --- checkpoints ---------------------------------------------------------------------------------


def test_the_newest_checkpoint_of_a_client_is_kept() -> None:
    stage = DataStage(deployment=program("run", DRIVE))
    assert stage.recalled().k == -1
    stage.handle(checkpoint(10), checkpoint(20), checkpoint(15), checkpoint(3, client="drive/other"))
    assert stage.recalled() == checkpoint(20)
    stage.handle(checkpoint(5, start=4))
    assert stage.recalled() == checkpoint(5, start=4)
    stage.kill_and_restart()
    assert stage.recalled() == checkpoint(5, start=4)
    assert stage.recalled("drive/other").k == 3


def test_strangers_keep_nothing_here(stage: DataStage) -> None:
    strange = (checkpoint(1), checkpoint(1, client="drive/stranger"))
    stage.handle(*strange)
    assert stage.handle(Recall(client="drive/go"), Recall(client="drive/stranger")) == []
    stage.connect().do(deploy(program("run", DRIVE)))
    assert stage.recalled().k == -1
    stage.handle(*strange)
    assert stage.recalled().k == 1
    assert stage.handle(Recall(client="drive/stranger")) == []


def test_who_the_clients_are_survives_a_death(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", DRIVE)))
    stage.handle(checkpoint(1))
    stage.kill_and_restart()
    stage.handle(checkpoint(2))
    assert stage.recalled().k == 2


def test_checkpoints_are_of_one_run(stage: DataStage) -> None:
    leader = stage.connect()
    leader.do(deploy(program("first", DRIVE)))
    stage.handle(checkpoint(10))
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("first", DRIVE)))
    assert stage.recalled() == checkpoint(10)
    leader.do(deploy(program("second", DRIVE)))
    assert stage.recalled().k == -1
    stage.kill_and_restart()
    assert stage.recalled().k == -1


def test_checkpoints_have_an_end() -> None:
    clients = tuple((str(number), number) for number in range(20))
    drive = table("drive", field("x"), server="RServer", clients=clients)
    stage = DataStage(deployment=program("run", drive))
    stage.handle(checkpoint(1, memory=b"m" * (1 << 20), client="drive/0"))
    stage.handle(checkpoint(2, memory=b"m" * ((1 << 20) + 1), client="drive/0"))
    assert stage.recalled("drive/0").k == 1
    assert stage.node.limit_messages() == ()
    for i in range(20):
        stage.handle(checkpoint(1, memory=b"m" * (1 << 20), client=f"drive/{i}"))
    kept = [i for i in range(20) if stage.recalled(f"drive/{i}").k == 1]
    assert kept == list(range(15)), "each counts for its name, too"
    assert stage.node.limit_messages() == (
        "checkpoints: 15.0 MiB of 16.0 MiB are used, and there was no room for more",
    )
    stage.handle(checkpoint(3, memory=b"m" * (1 << 20), client="drive/0"))
    assert stage.recalled("drive/0").k == 3


# --- what can go wrong ---------------------------------------------------------------------------


def test_bytes_that_are_no_message_are_counted_and_told(stage: DataStage) -> None:
    ada = stage.connect()
    effects = stage.handle(Malformed(topic="DServer/call", connection=ada.name, reason="nonsense"))
    assert [r.problem.code for r in ada.replies(effects) if r.problem] == ["malformed"]
    stage.handle(Malformed(topic="DServer/requests", connection=None, reason="nonsense"))
    stage.handle(Malformed(topic="DServer/checkpoints", connection=None, reason="nonsense"))
    assert ada.do(STATUS).last_malformed == "nonsense"


@pytest.mark.parametrize(
    ("key", "junk"),
    [
        (Key("value", "X"), b"\x93\x00\x00\xc4\x01\x01"),
        (Key("variable", "X"), b"nonsense"),
        (Key("semaphore", "S"), b"\xa1a"),
        (Key("answer", "ada/1"), b"\xc0"),
        (Key("checkpoint", "c"), b"\xc0"),
        (Key("watch", "ada/1"), b"\xc0"),
        (Key("sent", "lamp"), b"\xc0"),
        (Key("fact", "run"), b"\xff"),
    ],
    ids=str,
)
def test_a_store_whose_entries_make_no_sense_is_refused(key: Key, junk: bytes) -> None:
    store = MemoryStore()
    store.commit({key: junk})
    with pytest.raises(StoreError, match="is inconsistent"):
        DServer(store=store)


def test_closing_commits_and_lets_go_of_the_store(tmp_path: Any) -> None:
    path = tmp_path / "state.db"
    stage = DataStage(SqliteStore(path), deployment=program("run", DRIVE))
    stage.handle(checkpoint(1))
    list(stage.node.handle(checkpoint(2), stage.now_ns))
    stage.node.close()
    stage = DataStage(SqliteStore(path))
    assert stage.recalled().k == 2
    stage.node.close()


def test_nothing_leaves_where_it_cannot_be_kept() -> None:
    class Full(MemoryStore):
        def commit(self, changes: Any) -> None:
            raise StoreError("disk full")

    stage = DataStage(Full())
    ada = Caller(stage, "ada/1", 0)
    ada.open()
    with pytest.raises(StoreError, match="disk full"):
        ada.begin(data.set("X", 1))
    assert ada.replies(stage.effects) == ada.replies(stage.effects)[:1]
