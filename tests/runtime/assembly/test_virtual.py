"""Whole runs over scripted devices: repeatable, and the robot is stopped whatever ends them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.ir.expression import Binary, BinaryOperation, Constant, Expression, SensorValue
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Chain,
    Module,
    Program,
    PythonModule,
    PythonReading,
    Sensor,
    TransferFunction,
    Use,
    Wire,
)
from colony.ir.types import BOOL, DIMENSIONLESS
from colony.runtime.protocol.messages import Announcement, Message, Sample, ServerFrame
from colony.runtime.servers.runtime_server import random_of_frame
from tests.kit.node_stage import MS, S
from tests.runtime.programs import go, number, roam, robot
from tests.runtime.scripted import FAR, Log, Script, session


def near_after_2s(t: int) -> Sample:
    return Sample((400.0, *FAR[1:]) if t >= 2 * S else FAR, t)


def script() -> Script:
    return Script(sonar_at=near_after_2s, bumper_at=lambda t: 3 * S <= t < 3 * S + 100 * MS)


def run(program: Program, stage: Script, duration_ns: int = 5 * S, **options: object) -> Log:
    log = Log()
    assert session(program, stage, log, **options).run(duration_ns)
    return log


COMMANDS = {"cruise": (300.0, 0.0), "avoid": (60.0, 45.0), "back_off": (-200.0, 20.0), None: (0.0, 0.0)}


def test_a_run_does_what_the_program_says() -> None:
    stage = script()
    log = run(roam(), stage)
    winners = log.winners()
    assert len(winners) == 100
    assert set(winners[:40]) == {"cruise", None}
    assert set(winners[40:60]) == {"avoid", None}
    assert set(winners[60:81]) == {"back_off"}
    assert set(winners[82:]) == {"avoid", None}
    for k, winner in enumerate(winners):
        assert stage.told[k] == (k * 50 * MS, *COMMANDS[winner])
    assert len(stage.told) == 100
    assert stage.stopped == [0, 5 * S]
    assert log.closed == 1


def test_the_seed_decides_and_the_order_of_messages_does_not() -> None:
    by_seed = {}
    for seed in range(3):
        runs = {tuple(run(roam(), script(), seed=seed, order_seed=order).winners()) for order in range(4)}
        assert len(runs) == 1
        (by_seed[seed],) = runs
    assert len(set(by_seed.values())) == 3


def test_chance_is_a_function_of_seed_and_frame() -> None:
    log = run(roam(), script(), seed=7)
    readings = [frame.frame.readings["chance"] for frame in log.frames]
    assert readings == [random_of_frame(7, k) for k in range(100)]
    assert len(set(readings)) == 100
    assert all(isinstance(r, float) and 0.0 <= r < 1.0 for r in readings)
    many = [random_of_frame(1, k) for k in range(20_000)]
    assert abs(sum(many) / len(many) - 0.5) < 0.01


def test_a_sensor_that_is_not_measured_any_more_is_missing_after_within() -> None:
    def stuck(t: int) -> Sample:
        return Sample(FAR, min(t, 1 * S))

    log = run(roam(), Script(sonar_at=stuck), 2 * S)
    there = ["sonar" in f.frame.readings for f in log.frames]
    assert there == [k * 50 * MS - 1 * S <= 300 * MS for k in range(40)]
    assert "bumper" in log.frames[-1].frame.readings


def test_a_sensor_that_never_gave_a_value_is_missing() -> None:
    log = run(roam(), Script(sonar_at=lambda t: None), 1 * S)
    assert all("sonar" not in f.frame.readings for f in log.frames)


def test_a_server_that_stops_answering_is_idle_first_and_then_its_sensors_are_missing() -> None:
    def dead_after_1s(sender: str, receiver: str, message: Message) -> int | None:
        dead = isinstance(message, ServerFrame) and message.server == "PServer" and message.k >= 20
        return None if dead else 0

    log = run(roam(), Script(), 3 * S, link=dead_after_1s)
    assert log.winners()[:20].count("cruise") > 10
    fates = [dict(f.verdicts["drive"].fates).get("avoid") for f in log.frames if f.verdicts]
    assert "late" in fates[20:27]
    assert set(fates[27:]) == {"silent"}
    assert "PServer" in log.frames[-1].tick.down
    assert "sonar" not in log.frames[-1].frame.readings
    assert all(not f.disagreements for f in log.frames)


@pytest.mark.parametrize("problem", [RecursionError, KeyboardInterrupt])
def test_an_exception_stops_the_robot_and_closes_the_sinks(problem: type[BaseException]) -> None:
    def failing(t: int) -> Sample:
        if t >= 1 * S:
            raise problem
        return Sample(FAR, t)

    stage, log = Script(sonar_at=failing), Log()
    with pytest.raises(problem):
        session(roam(), stage, log).run(5 * S)
    assert stage.stopped == [0, 1 * S]
    assert log.closed == 1
    assert len(log.frames) == 20


def test_the_robot_is_stopped_even_where_a_sink_fails_too() -> None:
    class Full(Log):
        def close(self) -> None:
            raise OSError("disk full")

    stage, log = Script(), Log()
    with pytest.raises(OSError, match="disk full"):
        session(roam(), stage, Full(), log).run(1 * S)
    assert stage.stopped == [0, 1 * S]
    assert log.closed == 1


def test_a_request_to_stop_ends_between_two_frames() -> None:
    stage, log = Script(), Log()
    assert not session(roam(), stage, log).run(5 * S, stop=lambda: len(log.frames) == 7)
    assert len(log.frames) == 7
    assert len(stage.told) == 7
    assert len(stage.stopped) == 2


def test_contracts_are_monitored() -> None:
    program = roam()
    rammed = replace(program, modules=tuple(m for m in program.modules if m.name != "back_off"))
    rammed = replace(rammed, wires=(Wire(name="drive", actuator="drive", wiring=Use(name="cruise")),))
    log = run(rammed, script())
    assert [f.tick.k for f in log.frames if f.expected.breaches] == [60, 61]


# --- modules in Python ---------------------------------------------------------------------------


class Pulse:
    """Applicable in every third step."""

    def __init__(self, velocity: float) -> None:
        self.velocity = velocity
        self.steps = 0

    def step(self, frame: object) -> dict[str, float] | None:
        self.steps += 1
        return {"velocity": self.velocity, "turn": 0.0} if self.steps % 3 == 0 else None


def pulsing() -> Program:
    """A module in Python over one in the language, which needs the activity of the former."""
    pulse = PythonModule(
        name="pulse",
        module_path=__name__,
        class_name="Pulse",
        params=(("velocity", 50.0),),
        reads=(PythonReading(name="bumper", expression=SensorValue(type=BOOL, name="bumper")),),
        actuator="drive",
    )
    over = Chain(relation="suppresses", operands=(Use(name="pulse"), Use(name="cruise")), windows_ns=(0,))
    program = roam()
    return replace(
        program,
        modules=(pulse, program.modules[0]),
        wires=(Wire(name="drive", actuator="drive", wiring=over),),
    )


def test_guards_over_a_module_in_python_read_its_activity_from_dserver() -> None:
    log = run(pulsing(), Script(), 600 * MS)
    assert log.winners() == ["cruise", "cruise", "pulse"] * 4
    assert all(not f.disagreements for f in log.frames)


def test_while_the_activity_of_a_module_in_python_is_unknown_nobody_below_it_drives() -> None:
    def mute(sender: str, receiver: str, message: Message) -> int | None:
        return None if isinstance(message, Announcement) and message.k >= 6 else 0

    log = run(pulsing(), Script(), 3 * S, link=mute)
    assert log.winners()[:6] == ["cruise", "cruise", "pulse"] * 2
    assert set(log.winners()[6:]) == {None}
    assert all(not f.disagreements for f in log.frames)


# --- DServer -------------------------------------------------------------------------------------


def over(name: str, least: float) -> Expression:
    return BinaryOperation(
        type=BOOL,
        operator=Binary.GREATER,
        left=SensorValue(type=DIMENSIONLESS, name=name),
        right=number(least),
    )


def counting() -> Program:
    """Counts in a variable of DServer by reading what it wrote, and drives while `Goal` is set."""
    count = Sensor(name="count", type=DIMENSIONLESS, default=0.0, server="DServer", field="Count")
    goal = Sensor(name="goal", type=DIMENSIONLESS, server="DServer", field="Goal", within_ns=200 * MS)
    say = Actuator(
        name="say",
        fields=(ActuatorField(name="value", type=DIMENSIONLESS),),
        server="DServer",
        command="Count",
        idle=None,
    )
    more = BinaryOperation(
        type=DIMENSIONLESS,
        operator=Binary.ADD,
        left=SensorValue(type=DIMENSIONLESS, name="count"),
        right=number(1.0),
    )
    true = Constant(type=BOOL, value=True)
    return Program(
        robot=robot(count, goal, actuators=(say,)),
        modules=(
            Module(name="counter", when=true, command=TransferFunction(actuator="say", fields=(more,))),
            Module(name="drive_to", when=over("goal", 0.0), command=go(100.0, 0.0)),
        ),
        wires=(
            Wire(name="say", actuator="say", wiring=Use(name="counter")),
            Wire(name="drive", actuator="drive", wiring=Use(name="drive_to")),
        ),
    )


def test_what_an_actuator_sets_is_read_in_the_next_frame() -> None:
    log = run(counting(), Script(), 1 * S)
    assert [f.frame.readings.get("count") for f in log.frames] == [None, *map(float, range(1, 20))]
    assert [f.verdicts["say"].values for f in log.frames] == [(float(k),) for k in range(1, 21)]


def test_held_variables_are_fresh_in_every_frame() -> None:
    log = run(counting(), Script(), 1 * S, variables={"Goal": 1.0})
    assert log.winners() == ["drive_to"] * 20
    assert run(counting(), Script(), 1 * S).winners() == [None] * 20
