"""The server of a device: what its driver gives is held to the description, and nothing it does ends it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from colony.body.servers import in_declared_units
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_text
from colony.ir.servers import COMMON_SERVERS, CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import BOOL, DIMENSIONLESS, DISTANCE, Array, Enum, ScalarValue
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.kit.commands import CommandPerformer
from colony.runtime.kit.description import MAX_AGE_NS, describe, server_spec
from colony.runtime.kit.devices import NEVER_READ_NS, DeviceReader, device_commands, device_server
from colony.runtime.kit.once import RECOVERED_AFTER
from colony.runtime.kit.service import RETRY_SAFE_NS
from colony.runtime.library import emergency
from colony.runtime.library.ask import STATUS
from colony.runtime.protocol.messages import Reply, Sample, SendMessage, Tick, Wake
from colony.runtime.servers.drivers import MAX_PROBLEM_LENGTH, Drivers, Reading, problems_of
from colony.runtime.transport.virtual import VirtualClock
from tests.kit.calling import call_of
from tests.kit.node_stage import MS, NodeStage
from tests.runtime.scripted import Log

NOW_NS = 10_000 * MS


class Device:
    """A driver that gives what the test says, and notes what it is told. Mutable."""

    def __init__(self, found: object = None) -> None:
        self.found: Any = found if found is not None else {}
        self.failing_commands = False
        self.failing_safe = False
        self.commands: list[tuple[str, dict[str, ScalarValue]]] = []
        self.safes = 0

    def fields(self) -> Mapping[str, Reading | None]:
        found = self.found() if callable(self.found) else self.found
        if isinstance(found, Exception):
            raise found
        return found  # type: ignore[no-any-return]

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        self.commands.append((name, dict(values)))
        if self.failing_commands:
            raise OSError("port is gone")

    def safe(self) -> None:
        self.safes += 1
        if self.failing_safe:
            raise OSError("port is gone")

    def close(self) -> None:
        raise AssertionError("who makes a driver closes it")


def scan_of(**options: Any) -> FieldSpec:
    return FieldSpec("scan", Array(DISTANCE, 3), "ranges", **options)


def read(spec: FieldSpec, *found: object) -> tuple[list[Sample | None], list[str]]:
    """The samples of a frame for each of `found`, the readings of the field, and what was reported."""
    device, reports = Device(), list[str]()
    reader = DeviceReader(ServerSpec("S", fields=(spec,)), device, reports.append)
    samples = []
    for i, reading in enumerate(found):
        device.found = {spec.name: reading}
        samples.append(reader.read(NOW_NS + i * MS)[spec.name])
    return samples, reports


# --- what a driver may give ------------------------------------------------------------------------------

LEVEL = Enum("level", (("down", 0.0), ("up", 3.0)))

GOOD = [
    (FieldSpec("f", LEVEL, ""), Reading(3, 0), Sample(3.0, NOW_NS)),
    (FieldSpec("f", Array(LEVEL, 2), ""), Reading((3, 0.0), 0), Sample((3.0, 0.0), NOW_NS)),
    (FieldSpec("f", DIMENSIONLESS, ""), Reading(3, 0), Sample(3.0, NOW_NS)),
    (FieldSpec("f", DISTANCE, ""), Reading(0.5, 300 * MS), Sample(0.5, NOW_NS - 300 * MS)),
    (FieldSpec("f", DISTANCE, ""), Reading(0.5, 2**100), Sample(0.5, NOW_NS - MAX_AGE_NS)),
    (FieldSpec("f", BOOL, ""), Reading(True, 0), Sample(True, NOW_NS)),
    (FieldSpec("f", DISTANCE, ""), None, None),
    (FieldSpec("f", Array(BOOL, 2), ""), Reading((True, False), 1), Sample((True, False), NOW_NS - 1)),
    (scan_of(), Reading([1, 2.5, 3], 0), Sample((1.0, 2.5, 3.0), NOW_NS)),
    (scan_of(no_echo=9.0), Reading((1.0, math.inf, 3.0), 0), Sample((1.0, 9.0, 3.0), NOW_NS)),
    (scan_of(no_echo=9.0), Reading((math.inf,) * 3, 0), Sample((9.0,) * 3, NOW_NS)),
    (scan_of(no_echo=9.0, blocked=(0, 2)), Reading((1.0, 2.0, None), 0), Sample((9.0, 2.0, 9.0), NOW_NS)),
    (FieldSpec("f", DISTANCE, "", no_echo=9.0), Reading(math.inf, 0), Sample(9.0, NOW_NS)),
]


@pytest.mark.parametrize(("spec", "found", "published"), GOOD)
def test_a_reading_is_published_with_the_time_at_which_it_was_taken(
    spec: FieldSpec, found: object, published: Sample | None
) -> None:
    samples, reports = read(spec, found)
    assert repr(samples) == repr([published])
    assert reports == []


class Raising:
    """A reading of a driver that fails only when it is looked at."""

    def __repr__(self) -> str:
        raise RuntimeError("no text")


class RaisingReading(Reading):
    def __getattribute__(self, name: str) -> object:
        if name == "age_ns":
            raise RuntimeError("no age")
        return super().__getattribute__(name)


BAD = [
    (DISTANCE, 0.5, "is 0.5; expected Reading(value, age_ns)"),
    (DISTANCE, Raising(), "is <Raising instance at"),
    (DISTANCE, Reading("full", 0), "is 'full'; expected a finite number"),  # type: ignore[arg-type]
    (DISTANCE, Reading(True, 0), "is True; expected a finite number"),
    (DISTANCE, Reading(math.nan, 0), "is nan; expected a finite number"),
    (DISTANCE, Reading(math.inf, 0), "is inf; expected a finite number"),
    (DISTANCE, Reading(10**400, 0), "is 10000000000000000"),
    (DISTANCE, Reading((1.0, 2.0), 0), "is (1.0, 2.0); expected a finite number"),
    (BOOL, Reading(1.0, 0), "is 1.0; expected True or False"),
    (DISTANCE, Reading(0.5, -1), "has an age of -1 ns: a reading from the future"),
    (DISTANCE, Reading(0.5, 1.5), "has an age of 1.5; expected whole nanoseconds"),  # type: ignore[arg-type]
    (Array(DISTANCE, 3), Reading(1.0, 0), "is 1.0; expected a list or tuple of 3"),
    (Array(DISTANCE, 3), Reading((1.0, 2.0), 0), "has 2 elements; expected 3"),
    (
        Array(DISTANCE, 3),
        Reading((1.0,) * 4, 0),
        "has 4 elements; expected 3; leave out the last one if it repeats the first",
    ),
    (Array(DISTANCE, 3), Reading((1.0, "x", 2.0), 0), "is 'x'; expected a finite number"),  # type: ignore[arg-type]
    (Array(DISTANCE, 3), Reading((1.0, -math.inf, 2.0), 0), "is -inf; expected a finite number"),
    (Array(BOOL, 2), Reading((True, 1.0), 0), "is 1.0; expected True or False"),
    (LEVEL, Reading(2, 0), "is 2; expected 0 (down) or 3 (up)"),
    (LEVEL, Reading(True, 0), "is True; expected a finite number"),
    (Array(LEVEL, 2), Reading((3, 0.5), 0), "is 0.5; expected 0 (down) or 3 (up)"),
]


@pytest.mark.parametrize(("type_", "found", "problem"), BAD)
def test_what_a_field_cannot_be_is_no_value_and_is_reported_once(
    type_: Any, found: object, problem: str
) -> None:
    samples, reports = read(FieldSpec("f", type_, ""), found, found)
    assert samples == [None, None]
    [report] = reports
    assert report.startswith(f"S.f {problem}")


def test_a_reading_that_fails_when_it_is_looked_at_is_no_value() -> None:
    class Reads(dict[str, Any]):
        def get(self, name: str, default: object = None) -> object:  # type: ignore[override]
            raise RuntimeError("no such reading")

    fields = (FieldSpec("f", DISTANCE, ""), FieldSpec("g", DISTANCE, ""))
    device, reports = Device(), list[str]()
    reader = DeviceReader(ServerSpec("S", fields=fields), device, reports.append)
    device.found = {"f": RaisingReading(0.5, 0), "g": Reading(0.5, 0)}
    assert reader.read(NOW_NS) == {"f": None, "g": Sample(0.5, NOW_NS)}
    device.found = Reads()
    assert reader.read(NOW_NS) == {"f": None, "g": None}
    assert any("no age" in report for report in reports)
    assert any("no such reading" in report for report in reports)


FAILURES: list[tuple[object, str]] = [
    (OSError("port is gone"), "OSError: port is gone"),
    (KeyError("scan"), "KeyError: 'scan'"),
    (7, "TypeError: returned 7; expected the readings by name"),
    ([("f", Reading(0.5, 0))], "expected the readings by name"),
]


@pytest.mark.parametrize(("found", "problem"), FAILURES)
def test_a_driver_that_fails_has_no_values_until_it_works_again(found: object, problem: str) -> None:
    fields = (FieldSpec("f", DISTANCE, ""), FieldSpec("g", DISTANCE, ""))
    device, reports = Device(), list[str]()
    reader = DeviceReader(ServerSpec("S", fields=fields), device, reports.append)
    device.found = found
    assert [reader.read(NOW_NS) for _ in range(3)] == [{"f": None, "g": None}] * 3
    device.found = {"f": Reading(0.5, 0)}
    assert reader.read(NOW_NS) == {"f": Sample(0.5, NOW_NS), "g": None}
    [report] = reports
    assert report.startswith("fields of S failed:")
    assert problem in report


def test_a_field_that_the_description_lacks_is_reported_once_and_left_out() -> None:
    device, reports = Device({"f": Reading(0.5, 0), "extra": Reading(1.0, 0)}), list[str]()
    spec = ServerSpec("S", fields=(FieldSpec("f", DISTANCE, ""),))
    reader = DeviceReader(spec, device, reports.append)
    assert [reader.read(NOW_NS) for _ in range(2)] == [{"f": Sample(0.5, NOW_NS)}] * 2
    assert reports == ["S.extra is no field of the description"]


# --- elements that are invalid ---------------------------------------------------------------------------

WHOLE, PARTLY = Reading((1.0, 2.0, 3.0), 0), Reading((4.0, None, 6.0), 0)
OTHER, WRONG, DIRT = (Reading(found, 0) for found in ((None, 2.0, None), (9.0,), (1.0, "dirt", 3.0)))  # type: ignore[arg-type]
NEW, OLD, AROUND = (1, 2, 3), (4, 2, 6), (4, 9, 6)
PLAIN, HOLD, BLOCKED = scan_of(), scan_of(hold=True), scan_of(hold=True, no_echo=9.0, blocked=(1,))
ELEMENTS: list[tuple[str, FieldSpec, tuple[Reading | None, ...], list[tuple[float, ...] | None], int]] = [
    # its readings, a millisecond apart; what is published, and how old the last of it is in ms
    ("invalid for one frame", PLAIN, (WHOLE, PARTLY, WHOLE), [NEW, None, NEW], 0),
    ("NaN", PLAIN, (Reading((1.0, math.nan, 3.0), 0),), [None], 0),
    ("held, and as old as it is", HOLD, (WHOLE, PARTLY, PARTLY), [NEW, OLD, OLD], 2),
    ("held until it is valid", HOLD, (WHOLE, PARTLY, WHOLE), [NEW, OLD, NEW], 0),
    ("never valid before", HOLD, (PARTLY, PARTLY, OTHER), [None, None, OLD], 1),
    ("held through no array", HOLD, (WHOLE, None, PARTLY), [NEW, None, OLD], 2),
    ("held through a wrong array", HOLD, (WHOLE, WRONG, PARTLY), [NEW, None, OLD], 2),
    ("blocked", BLOCKED, (PARTLY, PARTLY, Reading((4.0, math.inf, 6.0), 0)), [AROUND] * 3, 0),
    ("blocked, and no number", BLOCKED, (DIRT,), [(1, 9, 3)], 0),
]


@pytest.mark.parametrize(
    ("spec", "found", "published", "age_ms"), [e[1:] for e in ELEMENTS], ids=[e[0] for e in ELEMENTS]
)
def test_an_element_is_missing_held_or_blocked(
    spec: FieldSpec, found: tuple[Reading | None, ...], published: list[tuple[float, ...] | None], age_ms: int
) -> None:
    samples, reports = read(spec, *found)
    assert [sample and sample.value for sample in samples] == published
    assert samples[-1] is None or samples[-1].t_ns == NOW_NS + (len(found) - 1 - age_ms) * MS
    assert len(reports) == (WRONG in found), "else a device says so in the course of things"


@pytest.mark.parametrize("hold", [False, True])
def test_an_element_without_an_echo_that_has_no_reading_is_invalid_and_reported_once(hold: bool) -> None:
    valid, without = Reading((1.0, 2.0, 3.0), 0), Reading((4.0, math.inf, math.inf), 0)
    samples, reports = read(scan_of(hold=hold), valid, without, without)
    held = Sample((4.0, 2.0, 3.0), NOW_NS)
    assert samples[1:] == ([held, held] if hold else [None, None])
    assert reports == ["S.scan is inf in element 1, which counts as invalid: the body gives no `no_echo`"]


# --- what the server says of itself ----------------------------------------------------------------------

GEAR = Enum("gear", (("low", 0.0), ("high", 1.0)))
LIFT = ServerSpec(
    "Lift",
    fields=(FieldSpec("height", DISTANCE, "height"), FieldSpec("moving", BOOL, "whether it moves")),
    commands=(
        CommandSpec(
            "move",
            (
                ParameterSpec("height", DISTANCE, "where to go", low=0.0, high=400.0),
                ParameterSpec("fast", BOOL, "whether it hurries"),
                ParameterSpec("gear", GEAR, "the gear"),
            ),
        ),
    ),
)


def test_its_description_says_what_the_spec_says() -> None:
    ada = NodeStage(device_server(LIFT, Device(), print)).connect()
    described = server_spec(ada.do(describe()))
    assert described.fields == LIFT.fields
    assert [(p.name, p.low, p.high) for p in described.commands[0].parameters] == [
        ("height", 0.0, 400.0),
        ("fast", None, None),
        ("gear", None, None),
    ]
    assert described.commands[0].parameters[2].type == GEAR


# --- devices that fail, and a robot that lives by them ---------------------------------------------------

PROGRAM = """
language 1
robot amr {
  sensor   scan[3] : mm  from Lidar.scan     within 300 ms
  sensor   height : mm   from Lift.height    within 300 ms
  actuator lift { height : mm range 0 .. 400, fast : bool }
           to Lift.move  idle lift(height = 0 mm, fast = false)
}
module up { when min(scan) > 500 mm  do lift(height = 400 mm, fast = true) }
network { lift = up }
contract known: last.lift by up implies last.up is active
"""
LIDAR = ServerSpec("Lidar", fields=(scan_of(no_echo=5000.0, hold=True),))
FAILS_AT_NS = 1_000 * MS
UP, IDLE = {"height": 400.0, "fast": True, "gear": 0.0}, {"height": 0.0, "fast": False, "gear": 0.0}


class Robot:
    """A robot with a lidar and a lift, whose drivers follow a script for 2 s. Mutable."""

    def __init__(self, scan: Callable[[int], object] = lambda t: Reading((900.0, 900.0, 900.0), 0)) -> None:
        self.clock, self.log, self.reports = VirtualClock(), Log(), list[str]()
        self.lidar = Device(lambda: self._found(scan))
        self.lift = Device({"height": Reading(0.0, 0), "moving": Reading(False, 0)})

    def _found(self, scan: Callable[[int], object]) -> object:
        found = scan(self.clock())
        return found if isinstance(found, Exception) else {"scan": found}

    def run(self) -> None:
        checked = check_text(PROGRAM)
        assert checked.program is not None, checked.diagnostics
        session = VirtualSession(
            compile_program(checked.program).compiled,
            Drivers(servers=(LIDAR, LIFT, *COMMON_SERVERS), devices={"Lidar": self.lidar, "Lift": self.lift}),
            clock=self.clock,
            seed=1,
            sinks=(self.log,),
            report=self.reports.append,
        )
        session.run(2_000 * MS)

    def roles(self) -> list[tuple[object, object]]:
        """Whether `up` got through and was active, in the frame before each."""
        found = [log.frame.readings for log in self.log.frames]
        return [(readings["last.lift by up"], readings["last.up is active"]) for readings in found]


def test_a_driver_that_works_moves_the_robot() -> None:
    robot = Robot()
    robot.run()
    assert robot.log.winners("lift") == ["up"] * 40
    assert robot.lift.commands[:-1] == [("move", UP)] * (len(robot.lift.commands) - 1)
    assert robot.roles() == [(None, None)] + [(True, True)] * 39
    assert robot.lift.commands[-1] == ("move", IDLE)  # as its server ends
    assert robot.reports == []


SLOW: list[Callable[[int], Reading]] = [
    lambda now_ns: Reading((900.0,) * 3, max(0, now_ns - FAILS_AT_NS)),  # the thread of the driver died
    lambda now_ns: Reading((900.0, 900.0 if now_ns <= FAILS_AT_NS else None, 900.0), 0),  # a beam is stuck
]


@pytest.mark.parametrize("scan", SLOW)
def test_a_scan_that_is_not_renewed_goes_missing_once_it_is_too_old(scan: Callable[[int], Reading]) -> None:
    robot = Robot(scan)
    robot.run()
    assert robot.log.winners("lift") == ["up"] * 27 + [None] * 13
    assert robot.reports == []


FAULTS: list[tuple[Callable[[int], object], str | None]] = [
    (lambda t: None, None),
    (lambda t: Reading((900.0, 900.0, 900.0), -3_600_000 * MS), "a reading from the future"),
    (lambda t: Reading((900.0, 900.0), 0), "has 2 elements; expected 3"),
    (lambda t: OSError("port is gone"), "OSError: port is gone"),
    (lambda t: RecursionError(), "RecursionError"),
]


@pytest.mark.parametrize(("faulty", "problem"), FAULTS)
def test_what_is_no_scan_is_missing_at_once_and_comes_back(
    faulty: Callable[[int], object], problem: str | None
) -> None:
    good, back_ns = Reading((900.0, 900.0, 900.0), 0), FAILS_AT_NS + 200 * MS

    robot = Robot(lambda t: faulty(t) if FAILS_AT_NS <= t < back_ns else good)
    robot.run()
    winners = robot.log.winners("lift")
    assert winners == ["up"] * 20 + [None] * 4 + ["up"] * 16
    assert len(robot.reports) == (problem is not None)
    assert problem is None or problem in robot.reports[0]


def test_a_lift_whose_commands_fail_is_made_safe_and_reported_once() -> None:
    robot = Robot()
    robot.lift.failing_commands = True
    robot.run()
    assert robot.log.winners("lift") == ["up"] * 40
    assert robot.lift.commands[:2] == [("move", UP), ("move", IDLE)]  # idle in its place, then safe
    assert robot.lift.safes >= 40
    assert robot.roles() == [(None, None)] + [(False, True)] * 39
    assert robot.reports == ["Lift.move failed: OSError: port is gone"]


def test_a_command_that_fails_while_its_driver_says_why_is_no_failure_of_its_own() -> None:
    class Opening(Device):
        is_opening = True
        problem: str | None = None

    device = Opening()
    device.failing_safe = True
    move = CommandSpec("move", (ParameterSpec("to", DISTANCE, "where"),))
    reports: list[str] = []
    performer = CommandPerformer(
        "Arm", device_commands(ServerSpec("Arm", commands=(move,)), device), reports.append
    )
    performer.make_safe("move")
    assert (performer.failing, reports, performer.is_safe) == ((), [], False)
    device.is_opening, device.problem = False, "the port is lost"
    performer.retry()
    assert (performer.failing, reports, performer.is_safe) == ((), [], False)
    device.problem = None
    performer.retry()
    assert performer.failing == tuple(reports) == ("safe of Arm.move failed: OSError: port is gone",)


def test_a_lift_that_cannot_even_be_made_safe_ends_no_server() -> None:
    robot = Robot()
    robot.lift.failing_commands = robot.lift.failing_safe = True
    robot.run()
    assert len(robot.log.frames) == 40
    assert sorted(robot.reports) == [
        "Lift.move failed: OSError: port is gone",
        "safe of Lift.move failed: OSError: port is gone",
    ]


def test_a_driver_gives_and_takes_numbers_in_the_units_of_the_interface() -> None:
    device = Device({"scan": Reading([1.5, math.inf], 0), "on": Reading(True, 0)})
    scan = FieldSpec("scan", Array(DISTANCE, 2), "ranges", no_echo=4000.0, factor=1000.0)
    move = CommandSpec("move", (ParameterSpec("to", DISTANCE, "where", factor=1000.0),))
    spec = ServerSpec("Arm", fields=(scan, FieldSpec("on", BOOL, "whether it is on")), commands=(move,))
    found = DeviceReader(spec, device, print).read(NOW_NS)
    assert found == {"scan": Sample((1500.0, 4000.0), NOW_NS), "on": Sample(True, NOW_NS)}
    program = """
    language 1
    robot r { frame 50 ms  sensor at : m from Arm.at  actuator arm { to : m } to Arm.move idle hold }
    module go { when true do arm(to = 2 m) }
    network { arm = go }
    """
    checked = check_text(program)
    assert checked.program is not None
    at, moving = FieldSpec("at", DISTANCE, "where it is"), FieldSpec("moving", BOOL, "whether it moves")
    home = CommandSpec("home", ())
    declared = in_declared_units(
        ServerSpec("Arm", fields=(at, moving), commands=(move, home)), checked.program.robot
    )
    assert declared.fields == (replace(at, factor=1000.0), replace(moving, is_read=False))
    assert [command.is_bound for command in declared.commands] == [True, False]
    device.found = {"at": Reading(1.0, 0)}
    drivers = Drivers(servers=(declared, *COMMON_SERVERS), devices={"Arm": device})
    log = Log()
    compiled = compile_program(checked.program).compiled
    VirtualSession(compiled, drivers, clock=VirtualClock(), seed=1, sinks=(log,)).run(200 * MS)
    assert ("move", {"to": 2.0}) in device.commands
    assert log.frames[-1].frame.readings["at"] == 1.0


def test_a_field_that_a_working_device_never_gives_is_reported_and_no_failure() -> None:
    class Opening(Device):
        is_opening, problem = True, None

    device, reports = Opening({"level": Reading(1.0, 0)}), list[str]()
    read = tuple(FieldSpec(name, DIMENSIONLESS, "") for name in ("level", "volts"))
    spec = ServerSpec("S", fields=(*read, FieldSpec("unread", DIMENSIONLESS, "", is_read=False)))
    reader = DeviceReader(spec, device, reports.append)
    for ready_ns in (0, NEVER_READ_NS):  # it works only from the second on
        reader.read(NOW_NS + ready_ns)
        device.is_opening = False
    reader.read(NOW_NS + 2 * NEVER_READ_NS - 1)
    assert reports == []
    device.found.clear()  # a field that was given once may be missing for ever
    for seconds in (2, 3, 4):
        reader.read(NOW_NS + seconds * NEVER_READ_NS)
    assert reports == ["S.volts is missing: the driver has never given it a value"]
    assert reader.failing == ()


@pytest.mark.parametrize("reached_ms", [0, 40, None])
def test_a_stop_is_answered_once_it_has_reached_the_device(reached_ms: int | None) -> None:
    class Guarded(Device):
        unreached: str | None = None

        def safe(self) -> None:
            self.unreached = "the guard has not sent it"

    device, answers = Guarded(), dict[int, Reply]()
    move = CommandSpec("move", (ParameterSpec("to", DISTANCE, "where"),))
    server = device_server(ServerSpec("Arm", commands=(move,)), device, print)
    list(server.start(0))
    for ms in range(0, 200, 2):
        device.unreached = None if reached_ms is not None and ms > reached_ms else device.unreached
        message = call_of(emergency.stop(), "eve/1") if ms % 30 == 0 else Wake()
        for effect in server.handle(message, ms * MS):
            if isinstance(effect, SendMessage) and isinstance(effect.message, Reply):
                answers.setdefault(ms, effect.message)
    [first, *repeated] = answers
    assert first == (150 if reached_ms is None else reached_ms + 2)
    assert [answers[ms] for ms in repeated] == [answers[first]] * len(repeated)
    problem = answers[first].problem
    assert (problem is None) == (reached_ms is not None)
    assert problem is None or problem.message.endswith(
        "has not reached its device: the guard has not sent it"
    )


def test_a_driver_that_exits_ends_nothing() -> None:
    def leave() -> object:
        raise SystemExit(3)

    reports: list[str] = []
    spec = ServerSpec("Arm", fields=(FieldSpec("at", DISTANCE, "where", factor=1000.0),))
    assert DeviceReader(spec, Device(leave), reports.append).read(NOW_NS) == {"at": None}
    found = {"at": Reading(1e308, 0)}  # infinite in base units
    assert DeviceReader(spec, Device(found), reports.append).read(NOW_NS) == {"at": None}
    assert [report.partition(":")[0] for report in reports] == [
        "fields of Arm failed",
        "Arm.at is 1e+308; expected a finite number",
    ]


# --- what fails now --------------------------------------------------------------------------------------


def _failing(stage: NodeStage, connection: str) -> tuple[str, ...]:
    """Return what the status of a server says that fails, over a connection of its own."""
    return stage.connect(connection).do(STATUS).failing


def test_the_status_of_the_server_says_what_fails_now() -> None:
    device = Device({"scan": Reading((1.0, 2.0, 3.0), 0)})
    stage = NodeStage(device_server(ServerSpec("S", fields=(scan_of(),)), device, lambda text: None))

    def frames(count: int) -> None:
        for _ in range(count):
            stage.now_ns += 100 * MS
            stage.handle(Tick(k=stage.now_ns // (100 * MS), t_ns=stage.now_ns))

    frames(1)
    assert _failing(stage, "ann/1") == ()
    device.found = ValueError("no bus")
    frames(1)
    assert _failing(stage, "ann/2") == ("fields of S failed: ValueError: no bus",)
    device.found = {"scan": Reading((1.0, 2.0), 0)}
    frames(RECOVERED_AFTER + 1)
    assert _failing(stage, "ann/3") == ("S.scan has 2 elements; expected 3",)
    device.found = {"scan": Reading((1.0, 2.0, 3.0), 0)}
    frames(RECOVERED_AFTER + 1)
    assert _failing(stage, "ann/4") == ()
    device.problem = "OSError: port is gone"  # type: ignore[attr-defined]  # as `Background` says it
    assert _failing(stage, "ann/5") == ("OSError: port is gone",)


def test_what_a_driver_says_of_itself_is_checked() -> None:
    class Broken:
        @property
        def problem(self) -> str:
            raise RuntimeError("no problem")

    class Odd:
        problem = 7

    class Long:
        problem = "x" * 1_000

    assert problems_of(object()) == problems_of(Broken()) == problems_of(Odd()) == ()
    assert problems_of(Long()) == ("x" * MAX_PROBLEM_LENGTH,)


def test_a_device_that_cannot_be_made_safe_is_tried_again_and_fails_until_it_can() -> None:
    device, reports = Device(), list[str]()
    device.failing_safe = True
    spec = ServerSpec("S", commands=(CommandSpec("set", (ParameterSpec("x", DIMENSIONLESS, ""),)),))
    stage = NodeStage(device_server(spec, device, reports.append))
    problem = "safe of S.set failed: OSError: port is gone"
    assert _failing(stage, "ann/1") == (problem,)
    stage.until(2 * RETRY_SAFE_NS)
    assert device.safes == 3
    device.failing_safe = False
    stage.until(9 * RETRY_SAFE_NS)
    assert device.safes == 4
    assert _failing(stage, "ann/2") == ()
    assert reports == [problem]
