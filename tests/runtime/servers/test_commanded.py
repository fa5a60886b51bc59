"""The rules of all servers with actuators, tested of the base and of a server written with the kit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import pytest
from msgspec import structs

from colony.execute.needs import BOUNDS
from colony.runtime.kit.commands import command, parameter
from colony.runtime.library import actuator, emergency, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Malformed,
    Request,
    Right,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
)
from colony.runtime.servers.outside_control import CLOCK_GRACE_NS
from colony.runtime.servers.rserver import RServer
from tests.kit.base import RollingBase
from tests.kit.calling import call_of
from tests.kit.lift import LIFT, program, service
from tests.kit.node_stage import FRAME_NS, MS, Caller, NodeStage, messages

NUMBER = ActuatorFieldSpec(name="value", kind="number", factor=1.0, low=0.0, high=400.0)
CLIENTS = (("up", 2), ("down", 1))


class Server(NamedTuple):
    """A server: the actuator that a program binds to it, and what its command sends as its only number."""

    spec: ActuatorSpec

    def ask(self, value: float, lease: float = 10.0) -> CallRequest[None]:
        if self.spec.server == "RServer":
            return robot.drive(value, 0.0, lease)
        return actuator.command("move", {"height": value}, lease)


SERVERS = (
    Server(
        structs.replace(
            LIFT, server="RServer", command="drive", fields=(NUMBER,), field_indices=(0, None), idle=(0.0,)
        )
    ),
    Server(structs.replace(LIFT, fields=(NUMBER,), field_indices=(0,), idle=(0.0,))),
)
by_server = pytest.mark.parametrize("server", SERVERS, ids=lambda server: server.spec.server)


class Stage(NodeStage):
    """A server whose actuator is at rest at 0, with a leader if a program is deployed. Mutable."""

    def __init__(self, server: Server, /, *, program_runs: bool = True, **changes: Any) -> None:
        self.server, self.k, self.run = server, 0, ""
        spec = structs.replace(server.spec, **{"clients": CLIENTS, "reported": (0,), **changes})
        self.program = program("run", spec)
        self._base, self._heights = RollingBase(), [0.0]

        def move(height: float) -> None:
            self._heights.append(height)

        height = parameter("height", low=0.0, high=400.0)
        lift = command(
            "move",
            lambda height: self._heights.append(height),
            height,
            safe=lambda: self._heights.append(0.0),
        )
        node = RServer(self._base) if self.is_base else service([], [lift], lambda problem: None)
        super().__init__(node)
        self.leader = self.connect("lead/1")
        if program_runs:
            self.leader.do(deploy(self.program))
            self.run = "run"

    @property
    def value(self) -> float:
        """What the actuator does: 0 at rest."""
        return self._base.velocity if self.is_base else self._heights[-1]

    @property
    def is_base(self) -> bool:
        return self.server.spec.server == "RServer"

    def arbitration(self, caller: Caller) -> Any:
        return caller.do(robot.arbitration() if self.is_base else actuator.arbitration())

    def tick(self, **options: Any) -> list[Effect]:
        self.until((self.k + 1) * FRAME_NS, [self.leader])
        self.k += 1
        return self.handle(Tick(k=self.k, t_ns=self.k * FRAME_NS, run=self.run, **options))

    def frame(
        self, value: float | None = None, bounds: float | None = None, **options: Any
    ) -> Verdict | None:
        """A frame in which `up` commands a value, or no client anything; gives its verdict."""
        before = len(self.effects)
        self.tick(**options)
        if bounds is not None:
            self.handle(Bounds(k=self.k, actuator="lift", low=(0.0,), high=(bounds,)))
        if self.run:
            bid = Request(k=self.k, actuator="lift", client="up", bid="inactive")
            if value is not None:
                bid = structs.replace(bid, bid="command", values=(value,))
            self.handle(bid, structs.replace(bid, client="down", bid="inactive", values=None))
        self.pass_time(41 * MS, [self.leader])
        found = messages(self.effects[before:], Verdict)
        return found[-1] if found else None


def given(effects: Sequence[Effect]) -> list[Any]:
    """What frames show of the command sent last."""
    found = [frame.fields.get("last.lift.value") for frame in messages(effects, ServerFrame)]
    return [sample.value for sample in found if sample is not None]


# --- priorities, locks -----------------------------------------------------------------------------


@by_server
def test_connection_above_the_clients_commands_and_one_below_only_while_they_are_idle(server: Server) -> None:
    for priority, decided in ((50, 100.0), (0, 300.0)):
        stage = Stage(server)
        stage.connect("eve/1", priority).do(server.ask(100.0, lease=1.0))
        verdict = stage.frame(300.0)
        assert verdict is not None
        outside = priority == 50
        assert (stage.value, verdict.values) == (decided, (decided,))
        assert (verdict.by, verdict.outside) == ((None, "eve/1") if outside else ("up", None))
        assert verdict.fates == (
            ("up", "overridden" if outside else "won"),
            ("down", "inactive"),
            *(() if outside else (("eve/1", "overridden"),)),
        )
        assert given(stage.tick()) == [decided]
        stage.frame()
        assert stage.value == 100.0, "as no client commands"


@by_server
def test_deployment_with_the_priority_of_a_connection_is_refused(server: Server) -> None:
    stage = Stage(server, program_runs=False)
    stage.tick()
    stage.connect("eve/1", 2).do(server.ask(100.0))
    problem = stage.leader.problem(deploy(stage.program))
    found = "`up` has priority 2, with which eve (eve/1) commands"
    assert (problem.code, problem.message) == ("tie", f"{server.spec.server}.deploy: {found}")


@by_server
def test_lock_keeps_out_all_but_its_holder_until_it_is_given_on(server: Server) -> None:
    stage = Stage(server)
    eve, bob, cy = (
        stage.connect(f"{name}/1", priority) for name, priority in (("eve", 50), ("bob", 60), ("cy", 70))
    )
    bob.do(server.ask(200.0))
    eve.do(actuator.lock())
    refused = bob.problem(server.ask(200.0))
    assert (refused.code, refused.message) == ("locked", "eve holds the lock")
    assert bob.refusal(actuator.lock(wait=False)) == "locked"
    verdict = stage.frame(300.0)
    assert verdict is not None
    assert (stage.value, verdict.hold, verdict.fates[0]) == (0.0, "locked", ("up", "locked out"))
    eve.do(server.ask(100.0, lease=1.0))
    stage.frame(300.0)
    assert stage.value == 100.0
    assert bob.refusal(actuator.unlock()) == "unlocked"
    for waiting in (bob, cy):
        assert waiting.replies(waiting.begin(actuator.lock())) == []
    lost_ns = stage.now_ns + 800 * MS  # without a sign of life
    stage.until(lost_ns, [stage.leader, bob, cy])
    assert cy.last is not None
    assert bob.last is None, "cy has the higher priority"
    cy.do(actuator.unlock())
    assert bob.last is not None


@by_server
def test_call_that_waits_for_the_lock_in_vain_is_refused(server: Server) -> None:
    stage = Stage(server)
    stage.connect("eve/1", 50).do(actuator.lock())
    bob = stage.connect("bob/1", 60)
    assert bob.replies(bob.begin(actuator.lock(wait_s=0.2))) == []
    [reply] = bob.replies(stage.pass_time(250 * MS))
    assert reply.problem is not None
    assert reply.problem.code == "locked"


# --- leases, ticks ---------------------------------------------------------------------------------


@by_server
def test_command_ends_with_its_lease_unless_it_is_repeated(server: Server) -> None:
    stage = Stage(server)
    eve = stage.connect("eve/1", 50)
    sent = []
    for k in range(6):
        if k in (0, 2):
            eve.do(server.ask(100.0 + k, lease=0.12))
        stage.frame()
        sent.append(stage.value)
    assert sent == [100.0, 100.0, 102.0, 102.0, 102.0, 0.0]


@by_server
def test_command_ends_with_its_connection(server: Server) -> None:
    stage = Stage(server)
    eve = stage.connect("eve/1", 50)
    eve.do(server.ask(100.0))
    stage.frame()
    eve.close()
    stage.frame()
    assert stage.value == 0.0


@by_server
def test_without_ticks_the_actuator_comes_to_rest_and_commands_are_refused(server: Server) -> None:
    stage = Stage(server, program_runs=False)
    stage.connect("eve/1", 50).do(server.ask(100.0))
    stage.tick()
    assert stage.value == 100.0
    stage.pass_time(3 * FRAME_NS)
    assert stage.value == 0.0
    stage.pass_time(CLOCK_GRACE_NS)
    problem = stage.connect("ann/1", 52).problem(server.ask(100.0))
    assert problem.code == "clock"
    assert f"no tick of the Clock reaches {server.spec.server}" in problem.message


@by_server
def test_command_of_a_frame_that_is_long_over_is_not_sent(server: Server) -> None:
    stage = Stage(server)
    stage.frame(300.0)
    stage.tick()
    stage.advance(stage.now_ns + 10 * FRAME_NS)  # without a wake
    stage.handle(Request(k=stage.k, actuator="lift", client="up", bid="command", values=(310.0,)))
    stage.handle(Request(k=stage.k, actuator="lift", client="down", bid="inactive"))
    assert stage.value == 0.0
    notes = messages(stage.effects, Verdict)[-1].notes
    assert notes == (f"frame {stage.k}: no command was sent, as the tick came too late",)
    assert given(stage.tick()) == [0.0]


@by_server
def test_messages_that_cannot_be_read_are_noted_and_move_nothing(server: Server) -> None:
    stage = Stage(server)
    stage.tick()
    topic = f"{server.spec.server}/requests"
    stage.handle(Malformed(topic=topic, connection=None, reason="found version 7"))
    bid = Request(k=stage.k, actuator="lift", client="up", bid="command", values=(math.nan,))
    stage.handle(bid, structs.replace(bid, client="down", bid="inactive", values=None))
    [verdict] = messages(stage.effects, Verdict)
    assert stage.value == 0.0
    assert verdict.notes == (
        "a request could not be read: found version 7",
        "`up` gave value = nan",
    )


@by_server
def test_client_that_is_late_or_lost_leaves_the_actuator_idle(server: Server) -> None:
    stage = Stage(server)
    stage.frame(300.0)
    stage.tick(lost=("lift/down",))
    assert stage.value == 300.0
    assert messages(stage.pass_time(41 * MS, [stage.leader]), Verdict) == []
    assert stage.value == 0.0
    bid = Request(k=stage.k, actuator="lift", client="up", bid="command", values=(300.0,))
    [verdict] = messages(stage.handle(bid), Verdict)
    assert (stage.value, verdict.fates) == (0.0, (("up", "late"), ("down", "lost")))


# --- limits ----------------------------------------------------------------------------------------


@by_server
def test_command_of_a_connection_is_held_to_the_bounds_of_its_frame(server: Server) -> None:
    stage = Stage(server, limited=True)
    stage.connect("eve/1", 50).do(server.ask(300.0, lease=1.0))
    verdict = stage.frame(bounds=250.0)
    assert verdict is not None
    assert (stage.value, verdict.values, verdict.unlimited) == (250.0, (250.0,), False)
    verdict = stage.frame()
    assert verdict is not None
    assert (stage.value, verdict.outside, verdict.fault) == (0.0, "eve/1", "limits unknown")
    assert dict(verdict.fates)[BOUNDS] == "late"
    assert verdict.notes == (f"limits of frame {stage.k} have not come",)
    stage.frame(bounds=180.0)
    assert stage.value == 180.0


@by_server
def test_connection_that_ignores_limits_is_shown_and_still_has_the_ranges(server: Server) -> None:
    stage = Stage(server, limited=True)
    eve = stage.connect("eve/1", 50)
    call = call_of(actuator.ignore_limits(), "eve/1", 50, 50)
    rights: tuple[Right, ...] = ("read", "command", "stop")
    for number, right in enumerate(rights, 50):
        stage.handle(structs.replace(call, right=right, number=number))
        problem = stage.replies["eve/1", number].problem
        assert problem is not None
        assert problem.code == "right"
    eve.number = 60
    eve.do(actuator.ignore_limits())
    eve.do(server.ask(400.0, lease=1.0))
    verdict = stage.frame()
    assert verdict is not None
    assert (stage.value, verdict.unlimited) == (400.0, True)
    [shown] = stage.arbitration(eve).outside
    assert shown.unlimited
    assert eve.refusal(server.ask(401.0)) == "arguments"
    eve.do(actuator.ignore_limits(False))
    verdict = stage.frame(bounds=250.0)
    assert verdict is not None
    assert (stage.value, verdict.unlimited) == (250.0, False)


@by_server
@pytest.mark.parametrize("by", ["leader", "program"])
def test_command_that_limits_held_ends_with_their_run(server: Server, by: str) -> None:
    stage = Stage(server, limited=True)
    stage.connect("eve/1", 50).do(server.ask(300.0))
    stage.frame(bounds=250.0)
    assert stage.value == 250.0
    if by == "leader":
        stage.leader.close()
        stage.run = ""
    else:
        stage.leader.do(deploy(structs.replace(stage.program, run="next")))
        stage.run = "next"
    stage.frame(bounds=400.0)
    stage.frame(bounds=400.0)
    assert stage.value == 0.0


# --- stops, runs -----------------------------------------------------------------------------------


@by_server
@pytest.mark.parametrize("by_tick", [False, True])
@pytest.mark.parametrize("program_runs", [False, True])
def test_emergency_stop_ends_all_commands_until_its_release(
    server: Server, program_runs: bool, by_tick: bool
) -> None:
    stage = Stage(server, program_runs=program_runs)
    eve = stage.connect("eve/1", 50)
    eve.do(actuator.lock())
    eve.do(server.ask(100.0))
    stage.tick()
    assert stage.value == 100.0
    stopped = Stopped(by="bob/1", t_ns=stage.now_ns)
    if by_tick:
        stage.tick(stopped=stopped)
    else:
        stage.handle(call_of(emergency.stop(), "bob/1"))
    assert stage.value == 0.0
    assert eve.refusal(server.ask(100.0)) == "stopped"
    verdict = stage.frame(300.0, stopped=stopped)
    assert verdict is not None
    assert (stage.value, verdict.hold) == (0.0, "stopped")
    stage.frame(released_ns=stage.now_ns)
    assert stage.value == 0.0, "the command is over"
    eve.do(server.ask(100.0))
    stage.frame()
    assert stage.value == 100.0


@by_server
def test_run_begins_and_ends_while_a_connection_commands(server: Server) -> None:
    stage = Stage(server, program_runs=False)
    stage.connect("eve/1", 50).do(server.ask(100.0))
    stage.frame()
    assert stage.value == 100.0
    stage.leader.do(deploy(stage.program))
    assert stage.frame() is None, "it has not begun"
    assert stage.value == 0.0
    stage.run = "run"
    stage.frame(300.0)
    assert stage.value == 100.0
    stage.run = "another"
    assert stage.frame() is None
    assert stage.value == 0.0
    stage.leader.close()
    stage.run = ""
    stage.frame()
    assert stage.value == 100.0


@by_server
def test_command_that_the_program_does_not_bind_stays_free_without_verdicts(server: Server) -> None:
    stage = Stage(server, server="Other")
    stage.connect("eve/1", 50).do(server.ask(100.0))
    assert stage.frame() is None
    assert stage.value == 100.0


@by_server
def test_deployment_of_the_same_run_changes_nothing_and_may_come_from_a_new_leader(server: Server) -> None:
    stage = Stage(server)
    stage.tick()
    stage.handle(Request(k=stage.k, actuator="lift", client="up", bid="command", values=(300.0,)))
    assert stage.value == 300.0
    second = Caller(stage, "lead/2")
    second.open()
    second.do(deploy(stage.program))
    stage.leader.close()
    stage.handle(Request(k=stage.k, actuator="lift", client="down", bid="inactive"))
    assert messages(stage.effects, Verdict)[-1].by == "up"
    assert stage.arbitration(second).leader == "lead/2"


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"command": "turn"}, "has no command `turn`"),
    ({"field_indices": ()}, "0 parameters; expected"),
    ({"fields": (), "idle": ()}, "is not one of its 0 fields"),
    ({"fields": (structs.replace(NUMBER, kind="bool"),)}, "is a bool"),
    ({"fields": (structs.replace(NUMBER, factor=0.0),)}, "a factor is 0"),
    ({"idle": (float("nan"),)}, "= nan when idle; expected a finite number"),
    ({"idle": (0.0, 1.0)}, "an idle command of 2 values, not 1"),
    ({"idle": ()}, "an idle command of 0 values, not 1"),
    ({"clients": (("a", 1), ("b", 2))}, "not in the order of their priorities"),
]


@by_server
@pytest.mark.parametrize(("changes", "reason"), WRONG)
def test_deployment_that_does_not_fit_the_server_is_refused_and_changes_nothing(
    server: Server, changes: dict[str, Any], reason: str
) -> None:
    stage = Stage(server)
    [spec] = stage.program.actuators
    problem = stage.leader.problem(deploy(program("next", structs.replace(spec, **changes))))
    assert (problem.code, reason in problem.message) == ("deployment", True), problem.message
    both = program("next", spec, structs.replace(spec, name="arm"))
    assert "`lift` and `arm` command " in stage.leader.problem(deploy(both)).message
    stage.frame(300.0)
    assert stage.value == 300.0
