"""Commands of servers written with the kit: what is declared of them, who decides, and what stops them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from msgspec import structs

from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.fields import field
from colony.runtime.kit.service import Service
from colony.runtime.library import clock as clock_library
from colony.runtime.library import emergency
from colony.runtime.library.ask import Ask
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Malformed,
    Message,
    Reply,
    Request,
    Send,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
    Wake,
    WakeAt,
)
from tests.runtime.calling import CLOSE, call_of, opening
from tests.runtime.kit.lift_stage import DOWN, FRAME_NS, IDLE, MS, UP, Robot


class Lift:
    """A device. Mutable: `done` is all that it was made to do."""

    def __init__(self) -> None:
        self.done: list[Any] = []
        self.failure: Exception | None = None

    def move(self, height: float, fast: bool) -> None:
        if self.failure is not None:
            raise self.failure
        self.done.append((height, fast))

    def safe(self) -> None:
        self.done.append("safe")

    def command(self) -> Command:
        return command(
            "move",
            self.move,
            parameter("height", unit="mm", low=0.0, high=400.0),
            parameter("fast", boolean=True),
            safe=self.safe,
        )


HEIGHT = ActuatorFieldSpec(name="height", kind="number", factor=1.0, low=0.0, high=400.0)
FAST = ActuatorFieldSpec(name="fast", kind="bool", factor=1.0, low=None, high=None)
LIFT = ActuatorSpec(
    name="lift",
    fields=(HEIGHT, FAST),
    server="Lift",
    command="move",
    field_indices=(0, 1),
    idle=(0.0, False),
    on_loss="stop",
    clients=(("up", 2), ("down", 1)),
    reported=(0, 1),
)
HOLDING = structs.replace(LIFT, idle=None)


def program(run: str = "run", *actuators: ActuatorSpec) -> Deployment:
    return Deployment(run=run, program="p", frame_ns=FRAME_NS, seed=0, actuators=actuators or (LIFT,))


class Stage:
    """A server with a lift, without any transport. Mutable: `now` is the present."""

    def __init__(self, *deployed: Deployment, lift: Lift | None = None) -> None:
        self.lift = Lift() if lift is None else lift
        self.reports: list[str] = []
        self.now = 1000 * MS
        self.calls = 0
        self.sent: list[Effect] = []
        fields = [field("height", lambda: 7.0, unit="mm")]
        self.service = Service("Lift", (), fields, self.reports.append, commands=[self.lift.command()])
        self.sent += self.service.start(self.now)
        assert self.take() == ["safe"], "nobody knows what it did before"
        if deployed:
            self.open()
            for program in deployed:
                assert self.do(deploy(program)).problem is None

    def handle(self, *messages: Message) -> list[Effect]:
        effects = [effect for message in messages for effect in self.service.handle(message, self.now)]
        self.sent += effects
        return effects

    def take(self) -> list[Any]:
        """What the lift was made to do since the last time."""
        done, self.lift.done = self.lift.done, []
        return done

    def tick(self, k: int, run: str = "run", **options: Any) -> list[Effect]:
        self.now += FRAME_NS
        return self.handle(Tick(k=k, t_ns=self.now, run=run, **options))

    def bid(self, k: int, *values: float | bool, client: str = "up", **options: Any) -> list[Effect]:
        request = Request(k=k, actuator="lift", client=client, bid="inactive")
        if values:
            request = structs.replace(request, bid="command", values=values)
        return self.handle(structs.replace(request, **options))

    def decide(self, k: int, *values: float | bool) -> list[Effect]:
        """A frame of which both clients are heard; `up` commands, or nobody."""
        return [*self.tick(k), *self.bid(k, *values), *self.bid(k, client="down")]

    def pass_time(self, ns: int) -> list[Effect]:
        end, effects = self.now + ns, list[Effect]()
        wakes = sorted({e.t_ns for e in self.sent if isinstance(e, WakeAt) and self.now < e.t_ns <= end})
        for due in [*wakes, end]:
            self.now = due
            effects += self.handle(Wake())
        return effects

    def open(self, connection: str = "ada/1") -> None:
        self.handle(call_of(opening("leader"), connection))
        self.calls = 1

    def do(self, ask: Ask[Any], connection: str = "ada/1") -> Reply:
        self.calls += 1
        effects = self.handle(call_of(ask, connection, self.calls))
        [reply] = [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Reply)]
        return reply


def verdicts(effects: Sequence[Effect]) -> list[Verdict]:
    return [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Verdict)]


def frames(effects: Sequence[Effect]) -> list[ServerFrame]:
    topic = topics.frames("Lift")
    return [e.message for e in effects if isinstance(e, Send) and e.topic == topic]  # type: ignore[misc]


# --- frames ----------------------------------------------------------------------------------------------


def test_the_command_of_a_frame_is_performed_once() -> None:
    stage = Stage(program())
    effects = stage.decide(1, 300.0, True)
    assert stage.take() == [(300.0, True)]
    [verdict] = verdicts(effects)
    assert (verdict.by, verdict.values, verdict.notes) == ("up", (300.0, True), ())
    stage.bid(1, 100.0, True, client="down")
    assert stage.take() == []


def test_a_client_that_is_late_leaves_the_actuator_idle() -> None:
    stage = Stage(program())
    stage.tick(1)
    stage.bid(1)
    assert stage.take() == []
    assert verdicts(stage.pass_time(40 * MS)) == []
    assert stage.take() == [(0.0, False)]
    [verdict] = verdicts(stage.bid(1, 300.0, True, client="down"))
    assert stage.take() == []
    assert verdict.fates == (("up", "inactive"), ("down", "late"))


def test_lost_clients_are_not_waited_for() -> None:
    stage = Stage(program())
    stage.tick(1, lost=("lift/up", "lift/down"))
    assert stage.take() == [(0.0, False)]


def test_where_nobody_commands_it_is_idle_in_each_frame_and_holds_if_that_is_declared() -> None:
    idle, holding = Stage(program()), Stage(program("run", HOLDING))
    for stage in (idle, holding):
        stage.decide(1, 300.0, True)
        stage.decide(2)
        stage.decide(3)
    assert idle.take() == [(300.0, True), (0.0, False), (0.0, False)]
    assert holding.take() == [(300.0, True)]


def test_the_next_frame_has_what_was_given_last() -> None:
    stage = Stage(program())

    def last(effects: list[Effect]) -> list[object]:
        [frame] = frames(effects)
        samples = [frame.fields.get(name) for name in ("last.lift.height", "last.lift.fast", "height")]
        return [sample and sample.value for sample in samples]

    assert last(stage.decide(1, 300.0, True)) == [None, None, 7.0]
    assert last(stage.decide(2)) == [300.0, True, 7.0]
    assert last(stage.decide(3)) == [0.0, False, 7.0]
    answers = [e.message for e in stage.sent if isinstance(e, Send) and e.topic == topics.ANSWERS]
    assert [(frame.k, dict(frame.fields)) for frame in answers] == [(1, {}), (2, {}), (3, {})]  # type: ignore[union-attr]


def test_a_field_that_the_actuator_does_not_declare_is_zero() -> None:
    alone = structs.replace(LIFT, fields=(HEIGHT,), field_indices=(0, None), idle=(5.0,), reported=())
    stage = Stage(program("run", alone))
    stage.decide(1, 300.0)
    stage.decide(2)
    assert stage.take() == [(300.0, False), (5.0, False)]


def test_what_cannot_be_read_is_noted_and_moves_nothing() -> None:
    stage = Stage(program())
    stage.tick(1)
    stage.handle(Malformed(topic=topics.requests("Lift"), connection=None, reason="truncated"))
    stage.bid(1, math.nan, True)
    stage.handle(Bounds(k=1, actuator="lift", low=(None, None), high=(None, None)))
    stage.pass_time(40 * MS)
    [verdict] = verdicts(stage.bid(1, client="down"))
    assert stage.take() == [(0.0, False)]
    assert "truncated" in verdict.notes[0]
    assert "height = nan" in verdict.notes[1]


# --- stops -----------------------------------------------------------------------------------------------

STOP = call_of(emergency.stop(), "eve/1")


def stop_by_call(stage: Stage) -> None:
    [reply] = [e.message for e in stage.handle(STOP) if isinstance(e, Send) and isinstance(e.message, Reply)]
    assert reply.problem is None


def stop_by_tick(stage: Stage) -> None:
    stage.tick(2, stopped=Stopped(by="eve/1", t_ns=stage.now))


def silence(stage: Stage) -> None:
    stage.pass_time(3 * FRAME_NS)


def end(stage: Stage) -> None:
    stage.service.close()


STOPS = [stop_by_call, stop_by_tick, silence, end]


@pytest.mark.parametrize("stopping", STOPS)
def test_whatever_stops_it_makes_the_actuator_idle_or_safe(stopping: Callable[[Stage], None]) -> None:
    for actuator, stopped in ((LIFT, (0.0, False)), (HOLDING, "safe")):
        stage = Stage(program("run", actuator))
        stage.decide(1, 300.0, True)
        stage.take()
        stopping(stage)
        assert set(stage.take()) == {stopped}


@pytest.mark.parametrize("stopping", STOPS)
def test_without_a_program_the_device_is_made_safe(stopping: Callable[[Stage], None]) -> None:
    stage = Stage()
    stage.tick(1, run="")
    assert stage.take() == []
    stopping(stage)
    assert stage.take() == ["safe"]


@pytest.mark.parametrize("stopping", [stop_by_call, stop_by_tick])
def test_it_stays_stopped_until_the_clock_releases_it(stopping: Callable[[Stage], None]) -> None:
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stopping(stage)
    stage.take()
    effects = stage.decide(3, 300.0, True)
    assert set(stage.take()) == {(0.0, False)}
    [frame] = frames(effects)
    assert frame.stopped is not None
    assert verdicts(effects)[-1].hold == "stopped"
    stage.tick(4, released_ns=stage.now)
    stage.bid(4, 300.0, True)
    assert stage.take()[-1] == (300.0, True)


def test_a_stop_in_the_middle_of_a_frame_ends_it() -> None:
    stage = Stage(program())
    stage.tick(1)
    stop_by_call(stage)
    assert set(stage.take()) == {(0.0, False)}
    stage.bid(1, 300.0, True)
    assert stage.take() == []


def test_a_silent_clock_stops_it_once_and_a_tick_goes_on() -> None:
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stage.take()
    stage.pass_time(2 * FRAME_NS)
    assert stage.take() == []
    stage.pass_time(20 * FRAME_NS)
    assert stage.take() == [(0.0, False)]
    stage.decide(2, 200.0, True)
    assert stage.take() == [(200.0, True)]


def test_a_tick_that_comes_too_late_moves_nothing() -> None:
    for actuator, instead in ((LIFT, (0.0, False)), (HOLDING, "safe")):
        stage = Stage(program("run", actuator))
        stage.tick(1)
        stage.now += 101 * MS
        stage.bid(1, 300.0, True)
        assert set(stage.take()) == {instead}
        [verdict] = verdicts(stage.bid(1, client="down"))
        assert verdict.notes == ("frame 1: no command was sent, as the tick came too late",)


# --- runs ------------------------------------------------------------------------------------------------


def test_it_is_idle_when_its_run_ends_and_holds_if_that_is_declared() -> None:
    for actuator, at_the_end in ((LIFT, [(0.0, False)]), (HOLDING, [])):
        stage = Stage(program("run", actuator))
        stage.decide(1, 300.0, True)
        stage.take()
        stage.tick(2, run="")
        stage.tick(3, run="")
        assert stage.take() == at_the_end


def test_two_runs_after_each_other() -> None:
    other = structs.replace(LIFT, name="arm", clients=(("reach", 1),))
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    assert stage.do(deploy(program("next", other))).problem is None
    assert stage.take() == [(300.0, True), (0.0, False)]
    stage.tick(2, run="next")
    stage.bid(2, 300.0, True)
    assert stage.take() == [], "which is a request of the run before"
    stage.bid(2, 100.0, True, actuator="arm", client="reach")
    assert stage.take() == [(100.0, True)]
    assert stage.do(deploy(program("next", other))).problem is None, "again, as after a lost connection"
    stage.tick(3, run="next")
    stage.bid(3, 120.0, True, actuator="arm", client="reach")
    assert stage.take() == [(120.0, True)]


def test_nobody_else_deploys_while_the_leader_is_there() -> None:
    stage = Stage(program())
    stage.open("bob/1")
    problem = stage.do(deploy(program("other")), "bob/1").problem
    assert problem is not None
    assert problem.code == "busy"
    stage.calls = 10
    stage.do(CLOSE)
    stage.calls = 10
    assert stage.do(deploy(program("other")), "bob/1").problem is None


WRONG = [
    (structs.replace(LIFT, command="turn"), "Lift has no command `turn`"),
    (structs.replace(LIFT, field_indices=(0,)), "1 parameters; expected 2"),
    (structs.replace(LIFT, field_indices=(0, 7)), "`fast` is not one of its 2 fields"),
    (structs.replace(LIFT, field_indices=(1, 0)), "`height` is a bool"),
    (structs.replace(LIFT, fields=(structs.replace(HEIGHT, factor=0.0), FAST)), "a factor is 0"),
    (structs.replace(LIFT, idle=(500.0, False)), "height = 500.0 when idle; expected 0 to 400"),
    (structs.replace(LIFT, idle=(math.nan, False)), "height = nan when idle; expected a finite number"),
    (structs.replace(LIFT, idle=(0.0, 1.0)), "fast = 1.0 when idle; expected a bool"),
    (structs.replace(LIFT, clients=(("a", 1), ("b", 2))), "not in the order of their priorities"),
]


@pytest.mark.parametrize(("actuator", "reason"), WRONG)
def test_a_program_that_does_not_fit_is_refused(actuator: ActuatorSpec, reason: str) -> None:
    stage = Stage()
    stage.open()
    problem = stage.do(deploy(program("run", actuator))).problem
    assert problem is not None
    assert problem.code == "deployment"
    assert reason in problem.message


def test_two_actuators_of_one_command_are_refused() -> None:
    stage = Stage()
    stage.open()
    problem = stage.do(deploy(program("run", LIFT, structs.replace(LIFT, name="arm")))).problem
    assert problem is not None
    assert "`lift` and `arm` command Lift.move" in problem.message


# --- failures of the device ------------------------------------------------------------------------------


def test_a_command_that_fails_is_not_sent_and_the_server_goes_on() -> None:
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stage.lift.failure = OSError("cable")
    [verdict] = verdicts(stage.decide(2, 310.0, True))
    assert stage.take() == [(300.0, True), "safe"], "as the idle command fails, too"
    effects = stage.decide(3, 320.0, True)
    assert verdict.notes == ("frame 2: Lift.move failed: OSError: 'cable'",)
    [frame] = frames(effects)
    assert frame.fields["last.lift.height"].value == 300.0  # type: ignore[union-attr]
    stage.lift.failure = None
    stage.decide(4, 330.0, True)
    assert stage.take() == ["safe", (330.0, True)]
    [report] = stage.reports
    assert report.startswith("Lift.move failed:\nTraceback")
    assert report.endswith("OSError: cable\n")


def test_where_only_a_command_fails_the_actuator_is_idle_for_that_frame() -> None:
    class Picky(Lift):
        def move(self, height: float, fast: bool) -> None:
            if height > 200.0:
                raise ValueError("too high")
            super().move(height, fast)

    stage = Stage(program(), lift=Picky())
    stage.decide(1, 100.0, True)
    stage.decide(2, 300.0, True)
    assert stage.take() == [(100.0, True), (0.0, False)]
    [frame] = frames(stage.tick(3))
    assert frame.fields["last.lift.height"].value == 0.0  # type: ignore[union-attr]


def test_a_command_out_of_the_range_of_the_device_is_not_sent() -> None:
    wide = structs.replace(LIFT, fields=(structs.replace(HEIGHT, high=1000.0), FAST))
    stage = Stage(program("run", wide))
    stage.decide(1, 500.0, True)
    [verdict] = verdicts(stage.decide(2, 600.0, True))
    assert stage.take() == [(0.0, False), (0.0, False)]
    assert verdict.notes == ("frame 2: Lift.move was not sent height = 600: expected 0 to 400",)
    assert stage.reports == ["Lift.move was not sent height = 500: expected 0 to 400"]


def test_a_safe_that_fails_ends_nothing() -> None:
    class Broken(Lift):
        def safe(self) -> None:
            super().safe()
            raise OSError("cable")

    stage = Stage(program("run", HOLDING), lift=Broken())
    stop_by_call(stage)
    assert stage.take() == ["safe"]
    stage.tick(1, released_ns=stage.now)
    stage.bid(1, 300.0, True)
    assert stage.take() == [(300.0, True)]
    [report] = stage.reports
    assert report.startswith("safe of Lift.move failed:\n")


# --- what is declared ------------------------------------------------------------------------------------

MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"name": "two words"}, "expected a name"),
    ({"unit": "m"}, "the unit `m`; expected base units"),
    ({"unit": "mm", "boolean": True}, "found several kinds"),
    ({"boolean": True, "members": {"a": 1}}, "found several kinds"),
    ({"members": {"a": 1}, "low": 0.0}, "found several kinds"),
    ({"members": {}}, "found the members"),
    ({"members": {"a": math.inf}}, "found the members"),
    ({"low": 1.0, "high": 0.0}, "expected finite ones in order"),
    ({"low": math.nan}, "expected finite ones in order"),
]


@pytest.mark.parametrize(("declared", "reason"), MISTAKES)
def test_mistakes_in_parameters(declared: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        parameter(**{"name": "x", **declared})


def test_parameters_and_commands_have_different_names() -> None:
    with pytest.raises(ValueError, match="expected each once"):
        command("move", print, parameter("x"), parameter("x"))
    with pytest.raises(ValueError, match="Lift: found two commands `move`"):
        Service("Lift", (), (), print, commands=[Lift().command(), Lift().command()])


def test_what_performs_a_command_must_take_its_parameters() -> None:
    with pytest.raises(ValueError, match=r"move: `perform` cannot be called .* unexpected .* 'speed'"):
        command("move", Lift().move, parameter("height"), parameter("fast"), parameter("speed"))
    with pytest.raises(ValueError, match="missing a required argument: 'fast'"):
        command("move", Lift().move, parameter("height"))
    assert command("any", lambda **given: None, parameter("x")).description.name == "any"
    assert command("min", min, parameter("key")).description.name == "min"


def test_what_performs_a_command_is_a_plain_function() -> None:
    async def later() -> None: ...

    with pytest.raises(ValueError, match="move: `perform` does nothing when it is called"):
        command("move", later)
    with pytest.raises(ValueError, match="move: `safe` does nothing when it is called"):
        command("move", print, safe=later)


# --- a whole robot in virtual time -----------------------------------------------------------------------


def test_a_program_drives_a_lift() -> None:
    robot = Robot()
    robot.run(12)
    assert [robot.told[k] for k in range(1, 10)] == [*[UP] * 5, DOWN, UP, DOWN, UP]
    assert [frame.verdicts["lift"].values for frame in robot.log.frames[1:10]] == [
        robot.told[k] for k in range(1, 10)
    ]
    assert not any(frame.disagreements for frame in robot.log.frames)
    assert robot.reports == []


def test_a_lift_whose_client_dies_is_idle() -> None:
    robot = Robot()
    [clients] = set(robot.robot.processes) - {"Clock", "DServer", "Lift"}
    robot.at(3, lambda: robot.robot.kill(clients))
    robot.run(12)
    assert [robot.told[k] for k in range(1, 4)] == [UP] * 3
    assert [robot.told[k] for k in range(4, 12)] == [IDLE] * 8
    assert not any(frame.disagreements for frame in robot.log.frames)


@pytest.mark.parametrize("server", ["Lift", "Clock"])
def test_a_stop_at_any_server_holds_for_the_lift_until_the_clock_releases_it(server: str) -> None:
    robot = Robot()
    robot.at(3, lambda: robot.call(server, emergency.stop()))
    robot.at(8, lambda: robot.call("Clock", opening("eve"), "eve/2"))
    robot.at(9, lambda: robot.call("Clock", clock_library.release(), "eve/2", 2))
    robot.run(14)
    assert [robot.told[k] for k in range(4, 10)] == [IDLE] * 6
    assert robot.told[11] == UP
    holds = [frame.verdicts["lift"].hold for frame in robot.log.frames[1:]]
    assert holds[4:9] == ["stopped"] * 5
    assert holds[10] is None
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_stop_survives_the_death_of_the_lift_and_of_the_clock() -> None:
    for killed in ("Lift", "Clock"):
        robot = Robot()
        robot.at(3, lambda robot=robot: robot.call("Lift", emergency.stop()))  # type: ignore[misc]
        robot.at(6, lambda robot=robot, killed=killed: robot.robot.restart(killed))  # type: ignore[misc]
        robot.at(7, robot.deploy)
        robot.run(20)
        assert {robot.told.get(k, IDLE) for k in range(4, 20)} == {IDLE}


def test_a_lift_that_comes_back_is_driven_again_once_the_program_is_deployed() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.restart("Lift"))
    robot.at(6, robot.deploy)
    robot.run(30)
    assert [k for k in range(4, 7) if k in robot.told] == []
    assert {robot.told[k] for k in range(8, 12)} <= {UP, DOWN, IDLE}
    assert {robot.told[k] for k in range(20, 30)} <= {UP, DOWN}
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_clock_that_dies_leaves_the_lift_idle() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.kill("Clock"))
    robot.run(12)
    assert max(robot.told) == 5
    assert robot.told[5] == IDLE
