"""DServer as a node: actuators bound to it, deployments, checkpoints, and bytes that are no message."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from colony.ir.frame import Answer
from colony.ir.servers import DSERVER
from colony.runtime.library import data
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import NoArguments, Status
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import (
    Announcement,
    Checkpoint,
    Effect,
    Fetch,
    Malformed,
    Recall,
    Request,
    Send,
    ServerFrame,
    SettlingNode,
    Tick,
    Verdict,
    Wake,
)
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.sqlite import SqliteStore
from colony.runtime.store.store import Key, MemoryStore, StoreError
from tests.kit.data import DataStage
from tests.kit.node_stage import MS, Caller, CallError, S, messages


def field(name: str, kind: Any = "number") -> ActuatorFieldSpec:
    return ActuatorFieldSpec(name=name, kind=kind, factor=1.0, low=None, high=None)


def table(
    name: str,
    *fields: ActuatorFieldSpec,
    server: str = DSERVER.name,
    clients: tuple[tuple[str, int], ...] = (("counter", 1),),
) -> ActuatorSpec:
    return ActuatorSpec(
        name=name,
        fields=fields,
        server=server,
        command=name.title(),
        field_indices=(),
        idle=None,
        on_loss="stop",
        clients=clients,
    )


LAMP, POSE = table("lamp", field("on", "bool")), table("pose", field("x"), field("y"))


DRIVE = table("drive", field("x"), server="RServer", clients=(("go", 1), ("other", 2)))


def program(
    run: str, *actuators: ActuatorSpec, python_modules: tuple[str, ...] = (), reads: tuple[str, ...] = ()
) -> Deployment:
    return Deployment(
        run=run,
        program="demo",
        frame_ns=50 * MS,
        seed=1,
        actuators=actuators,
        python_modules=python_modules,
        reads=reads,
    )


def deploy(deployed: Deployment) -> Ask[None]:
    return Ask("deploy", deployed, type(None), "command")


def request(k: int, actuator: str, *values: float | bool) -> Request:
    return Request(k=k, actuator=actuator, client="counter", bid="command", values=values)


def verdicts(effects: list[Effect]) -> list[Verdict]:
    return messages(effects, Verdict)


def tick(stage: DataStage, k: int, run: str = "run") -> list[Effect]:
    return stage.handle(Tick(k=k, t_ns=stage.now_ns, run=run))


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
    assert last(tick(stage, 0)) == {}
    stage.handle(request(0, "lamp", True), request(0, "quiet", 1.0, 2.0), request(0, "off", True))
    assert last(tick(stage, 1)) == {"last.lamp.on": True, "last.off.on": True}
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(tick(stage, 2)) == {"last.lamp.on": True}
    stage.handle(request(2, "lamp", False))
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(tick(stage, 3)) == {"last.lamp.on": False}
    leader.do(deploy(program("next", held, quiet, off)))
    assert last(tick(stage, 4, "next")) == {}, "of another run"
    leader.do(deploy(program("run", held, quiet, off)))
    assert last(tick(stage, 5)) == {}


def test_it_has_something_to_settle(stage: DataStage) -> None:
    assert isinstance(stage.node, SettlingNode)
    assert len(set(stage.node.listens)) == len(stage.node.listens)


# --- deployments ---------------------------------------------------------------------------------


def test_what_a_command_of_a_frame_sets_is_read_in_the_next(stage: DataStage) -> None:
    leader = stage.connect("ada/leader")
    leader.do(deploy(program("run", LAMP, POSE, reads=("Lamp", "Pose"))))
    assert [e for e in tick(stage, 7) if isinstance(e, Send)] != []
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
    tick(stage, 1)
    assert leader.changes(stage.handle(request(1, "lamp", True))) == [("Lamp", True)]


def test_one_run_at_a_time(stage: DataStage) -> None:
    ada, bob = stage.connect("ada/1"), stage.connect("bob/1")
    ada.do(deploy(program("first", LAMP)))
    ada.do(deploy(program("first", LAMP)))
    with pytest.raises(CallError, match="which ada leads") as failed:
        bob.do(deploy(program("second", POSE)))
    assert failed.value.code == "busy"
    ada.do(deploy(program("third", LAMP)))
    ada.close()
    bob.do(deploy(program("second", POSE)))


def test_a_leader_that_died_stands_in_nobodys_way_after_a_second(stage: DataStage) -> None:
    ada, bob = stage.connect("ada/1"), stage.connect("bob/1")
    ada.do(deploy(program("first", LAMP)))
    stage.pass_time(S, alive=(bob,))
    bob.do(deploy(program("second", POSE)))


def test_the_same_run_again_changes_nothing(stage: DataStage) -> None:
    leader = stage.connect()
    leader.do(deploy(program("run", LAMP)))
    tick(stage, 1)
    leader.do(deploy(program("run", LAMP)))
    assert len(verdicts(stage.handle(request(1, "lamp", True)))) == 1


def test_impossible_deployments_are_refused(stage: DataStage) -> None:
    leader = stage.connect()
    wrong = Deployment(run="r", program="demo", frame_ns=0, seed=1, actuators=())
    with pytest.raises(CallError, match="0 ns"):
        leader.do(deploy(wrong))


def test_in_frames_of_another_run_nothing_is_decided(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", LAMP)))
    tick(stage, 1)
    effects = tick(stage, 2, run="")
    assert [v.k for v in verdicts(effects)] == [1]
    assert verdicts(stage.handle(request(2, "lamp", True))) == []
    stage.now_ns += S
    assert verdicts(stage.handle(Wake()) + tick(stage, 3, run="")) == []
    assert stage.fields(4) == {}


def test_activities_of_announced_modules_are_handed_on(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", python_modules=("pulse",))))
    (sent,) = stage.handle(Announcement(k=3, module="pulse", answer=Answer((300.0, 5.0))))
    assert isinstance(sent, Send)
    assert isinstance(sent.message, ServerFrame)
    assert sent.message.server == "DServer/activity/pulse"
    assert stage.handle(Fetch(server="DServer/activity/pulse", k=3)) == [sent]
    assert stage.handle(Announcement(k=3, module="stranger", answer=Answer((300.0, 5.0)))) == []


# --- checkpoints ---------------------------------------------------------------------------------


def checkpoint(k: int, start: int = 0, memory: bytes = b"m", client: str = "drive/go") -> Checkpoint:
    return Checkpoint(client=client, k=k, start=start, memory=memory)


def recalled(stage: DataStage, client: str = "drive/go") -> Checkpoint:
    (sent,) = stage.handle(Recall(client=client))
    assert isinstance(sent, Send)
    assert sent.topic == f"DServer/recalled/{client}"
    assert isinstance(sent.message, Checkpoint)
    return sent.message


def test_the_newest_checkpoint_of_a_client_is_kept() -> None:
    stage = DataStage(deployment=program("run", DRIVE))
    assert recalled(stage).k == -1
    stage.handle(checkpoint(10), checkpoint(20), checkpoint(15), checkpoint(3, client="drive/other"))
    assert recalled(stage) == checkpoint(20)
    stage.handle(checkpoint(5, start=4))
    assert recalled(stage) == checkpoint(5, start=4)
    stage.kill_and_restart()
    assert recalled(stage) == checkpoint(5, start=4)
    assert recalled(stage, "drive/other").k == 3


def test_strangers_keep_nothing_here(stage: DataStage) -> None:
    strange = (checkpoint(1), checkpoint(1, client="drive/stranger"))
    stage.handle(*strange)
    assert stage.handle(Recall(client="drive/go"), Recall(client="drive/stranger")) == []
    stage.connect().do(deploy(program("run", DRIVE)))
    assert recalled(stage).k == -1
    stage.handle(*strange)
    assert recalled(stage).k == 1
    assert stage.handle(Recall(client="drive/stranger")) == []


def test_who_the_clients_are_survives_a_death(stage: DataStage) -> None:
    stage.connect().do(deploy(program("run", DRIVE)))
    stage.handle(checkpoint(1))
    stage.kill_and_restart()
    stage.handle(checkpoint(2))
    assert recalled(stage).k == 2


def test_checkpoints_are_of_one_run(stage: DataStage) -> None:
    leader = stage.connect()
    leader.do(deploy(program("first", DRIVE)))
    stage.handle(checkpoint(10))
    stage.kill_and_restart()
    leader.open()
    leader.do(deploy(program("first", DRIVE)))
    assert recalled(stage) == checkpoint(10)
    leader.do(deploy(program("second", DRIVE)))
    assert recalled(stage).k == -1
    stage.kill_and_restart()
    assert recalled(stage).k == -1


def test_checkpoints_have_an_end() -> None:
    clients = tuple((str(number), number) for number in range(20))
    drive = table("drive", field("x"), server="RServer", clients=clients)
    stage = DataStage(deployment=program("run", drive))
    stage.handle(checkpoint(1, memory=b"m" * (1 << 20), client="drive/0"))
    stage.handle(checkpoint(2, memory=b"m" * ((1 << 20) + 1), client="drive/0"))
    assert recalled(stage, "drive/0").k == 1
    assert stage.node.limit_messages() == ()
    for i in range(20):
        stage.handle(checkpoint(1, memory=b"m" * (1 << 20), client=f"drive/{i}"))
    kept = [i for i in range(20) if recalled(stage, f"drive/{i}").k == 1]
    assert kept == list(range(15)), "each counts for its name, too"
    assert stage.node.limit_messages() == (
        "checkpoints: 15.0 MiB of 16.0 MiB are used, and there was no room for more",
    )
    stage.handle(checkpoint(3, memory=b"m" * (1 << 20), client="drive/0"))
    assert recalled(stage, "drive/0").k == 3


# --- what can go wrong ---------------------------------------------------------------------------


def test_bytes_that_are_no_message_are_counted_and_told(stage: DataStage) -> None:
    ada = stage.connect()
    effects = stage.handle(Malformed(topic="DServer/call", connection=ada.name, reason="nonsense"))
    assert [r.problem.code for r in ada.replies(effects) if r.problem] == ["malformed"]
    stage.handle(Malformed(topic="DServer/requests", connection=None, reason="nonsense"))
    stage.handle(Malformed(topic="DServer/checkpoints", connection=None, reason="nonsense"))
    status = ada.do(Ask("status", NoArguments(), Status, "read"))
    assert status.last_malformed == "nonsense"


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
    assert recalled(stage).k == 2
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
