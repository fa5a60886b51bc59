"""Sensors and actuators are bound to what servers have, or it is said where they are not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.ir.fitting import name_hint
from colony.ir.program import Actuator, ActuatorField, Program, Sensor
from colony.ir.servers import (
    SPEED,
    TURN_RATE,
    CommandSpec,
    FieldSpec,
    ParameterSpec,
    ServerSpec,
)
from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, DISTANCE, Array, Enum, Type
from colony.runtime.protocol.bindings import SensorBinding, bind
from colony.text.diagnostics import DiagnosticError, render
from colony.text.source import Source, Span
from colony.text.units import parse_unit
from tests.robot_servers import ROME_SERVERS
from tests.runtime.programs import drive, roam, robot


def with_sensor(type: Type, server: str, field: str, factor: float = 1.0) -> Program:
    return Program(robot=robot(Sensor(name="s", type=type, server=server, field=field, factor=factor)))


def test_a_good_program_is_bound() -> None:
    bound = bind(roam().robot, ROME_SERVERS)
    assert [(b.sensor, b.server, b.field) for b in bound.sensors] == [
        ("sonar", "PServer", "sonar"),
        ("bumper", "RServer", "bumper"),
        ("chance", "Runtime", "random"),
    ]
    (actuator,) = bound.actuators
    assert (actuator.server, actuator.command, actuator.field_indices) == ("RServer", "drive", (0, 1))


BAD_SENSORS = [
    (BOOL, "Pserver", "sonar", "R001", "no server `Pserver`", "`PServer`"),
    (DISTANCE, "CServer", "lights", "R001", "no server `CServer`", "?"),
    (Array(DISTANCE, 24), "PServer", "sonars", "R002", "no field `sonars`", "`sonar`"),
    (BOOL, "RServer", "qqq", "R002", "no field `qqq`", "front_bumper"),
    (Array(DISTANCE, 12), "PServer", "sonar", "R003", "mm[24], not mm[12]", "range"),
    (DISTANCE, "PServer", "sonar", "R003", "mm[24], not mm", "range"),
    (DEGREES, "RServer", "x", "R003", "mm, not deg", "east"),
    (BOOL, "RServer", "heading", "R003", "deg, not bool", "north"),
    (Enum("goal", (("none", 0.0),)), "RServer", "bumper", "R003", "bool, not goal", "touches"),
]


@pytest.mark.parametrize(("type", "server", "field", "code", "message", "hint"), BAD_SENSORS)
def test_a_sensor_bound_to_nothing_is_an_error_with_a_hint(
    type: Type, server: str, field: str, code: str, message: str, hint: str
) -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(with_sensor(type, server, field).robot, ROME_SERVERS)
    (found,) = failed.value.diagnostics
    assert found.code == code
    assert message in found.message
    assert hint in (found.hint or "")


def test_errors_are_at_the_declaration_and_all_are_told() -> None:
    source = Source("rome.colony", "sensor a : bool from RServer.bumpre\nsensor b : bool from Server.x\n")
    first, second = Span(source, 7, 8), Span(source, 43, 44)
    program = Program(
        robot=robot(
            Sensor(name="a", type=BOOL, server="RServer", field="bumpre", span=first),
            Sensor(name="b", type=BOOL, server="Server", field="x", span=second),
        )
    )
    with pytest.raises(DiagnosticError) as failed:
        bind(program.robot, ROME_SERVERS)
    texts = [render(d) for d in failed.value.diagnostics]
    assert texts[0].startswith("rome.colony:1:8: error[R002]: `a`: RServer has no field `bumpre`")
    assert "did you mean `bumper`?" in texts[0]
    assert texts[1].startswith("rome.colony:2:8: error[R001]")


def test_dserver_has_every_field_and_plain_numbers_take_base_units() -> None:
    bound = bind(with_sensor(DISTANCE, "DServer", "Anything", factor=1000.0).robot, ROME_SERVERS).sensors[-1]
    assert (bound.field, bound.factor, bound.declared) == ("Anything", 1000.0, True)
    assert bind(with_sensor(DIMENSIONLESS, "RServer", "x").robot, ROME_SERVERS).sensors[-1].factor == 1.0
    hardware = bind(with_sensor(DISTANCE, "RServer", "x", factor=1000.0).robot, ROME_SERVERS).sensors[-1]
    assert (hardware.factor, hardware.declared) == (1000.0, False)


ANY_NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
UNITS = ("m", "cm", "inch", "ft", "rad", "min", "ms", "m/s", "rad/s", "ft^2")


@given(ANY_NUMBERS, st.sampled_from(UNITS), st.booleans())
def test_executors_compute_with_what_a_reading_in_the_declared_unit_means(
    value: float, unit: str, declared: bool
) -> None:
    """What is recorded, times the factor, is what executors of the runtime got, bit for bit."""
    factor = float(parse_unit(unit).factor)
    binding = SensorBinding(
        sensor="s", server="S", field="f", max_age_ns=None, factor=factor, declared=declared
    )
    recorded = binding.in_declared_units((value, True, -value))
    assert isinstance(recorded, tuple)
    inside = binding.in_base_units((value, True, -value))
    assert repr(inside) == repr(tuple(x if x is True else x * factor for x in recorded))
    assert recorded[1] is True
    if declared:
        assert recorded[0] == value


def command_to(command: str, *fields: ActuatorField, server: str = "RServer") -> Program:
    actuator = Actuator(name="wheels", fields=fields, server=server, command=command, idle=None)
    return Program(robot=replace(robot(), actuators=(actuator,)))


def test_parameters_are_found_by_name_and_may_be_left_out() -> None:
    turn, velocity = ActuatorField(name="turn", type=TURN_RATE), ActuatorField(name="velocity", type=SPEED)
    assert bind(command_to("drive", turn, velocity).robot, ROME_SERVERS).actuators[0].field_indices == (1, 0)
    assert bind(command_to("drive", turn).robot, ROME_SERVERS).actuators[0].field_indices == (None, 0)


BAD_COMMANDS = [
    ("driv", ActuatorField(name="velocity", type=SPEED), "R004", "`drive`"),
    ("drive", ActuatorField(name="speed", type=SPEED), "R005", "velocity"),
    ("drive", ActuatorField(name="turn", type=SPEED), "R003", "turning"),
    ("drive", ActuatorField(name="turn", type=BOOL), "R003", "turning"),
]


@pytest.mark.parametrize(("command", "field", "code", "hint"), BAD_COMMANDS)
def test_a_command_that_no_server_takes(command: str, field: ActuatorField, code: str, hint: str) -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(command_to(command, field).robot, ROME_SERVERS)
    (found,) = failed.value.diagnostics
    assert found.code == code
    assert hint in (found.hint or "")


def test_a_sensor_server_takes_no_commands() -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(command_to("sonar", server="PServer").robot, ROME_SERVERS)
    assert failed.value.diagnostics[0].hint == "there is none"


def test_two_actuators_on_one_command_would_not_be_arbitrated() -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(replace(robot(), actuators=(drive(), replace(drive(), name="wheels"))), ROME_SERVERS)
    assert failed.value.diagnostics[0].code == "R006"


def test_the_nearest_name_or_all_that_are_known() -> None:
    assert name_hint("rserver", ["PServer", "RServer"]) == "did you mean `RServer`?"
    assert name_hint("camera", ["PServer", "RServer"]) == "expected one of: PServer, RServer"
    assert name_hint("camera", []) == "there is none"


@pytest.mark.parametrize(
    ("has_age", "within_ns", "fits"),
    [(True, 300_000_000, True), (False, None, True), (False, 300_000_000, False)],
)
def test_a_sensor_within_a_time_reads_only_a_field_that_has_an_age(
    has_age: bool, within_ns: int | None, fits: bool
) -> None:
    spec = FieldSpec("scan", Array(DISTANCE, 3), "ranges", has_age=has_age)
    sensor = Sensor(name="scan", type=spec.type, server="Lidar", field="scan", within_ns=within_ns)
    servers = (*ROME_SERVERS, ServerSpec("Lidar", fields=(spec,)))
    if fits:
        assert bind(robot(sensor), servers).sensors[-1].max_age_ns == within_ns
        return
    with pytest.raises(DiagnosticError) as failed:
        bind(robot(sensor), servers)
    (found,) = failed.value.diagnostics
    assert found.code == "R007"
    assert "`scan` must be measured within 300 ms, but Lidar.scan does not say" in found.message
    assert "has_age=True" in (found.hint or "")


def test_the_fields_that_every_robot_has_can_be_held_to_a_time() -> None:
    assert all(field.has_age for server in ROME_SERVERS for field in server.fields)
    shared = Sensor(name="goal", type=DISTANCE, server="DServer", field="Goal", within_ns=1_000_000_000)
    assert bind(robot(shared), ROME_SERVERS).sensors[-1].max_age_ns == 1_000_000_000


# --- commands of servers that have ranges --------------------------------------------------------------

POSITIONS = (("down", 0.0), ("up", 2.0))
LIFT = ServerSpec(
    "Lift",
    commands=(
        CommandSpec("move", (ParameterSpec("height", DISTANCE, "height", low=0.0, high=400.0),)),
        CommandSpec("push", (ParameterSpec("force", DIMENSIONLESS, "", low=5.0),)),
        CommandSpec("go", (ParameterSpec("position", Enum("position", POSITIONS), ""),)),
    ),
)


def lift(command: str, *fields: ActuatorField) -> Actuator:
    return Actuator(name="lift", fields=fields, server="Lift", command=command, idle=None)


def height(low: float | None, high: float | None) -> ActuatorField:
    return ActuatorField(name="height", type=DISTANCE, low=low, high=high)


def force(low: float | None) -> ActuatorField:
    return ActuatorField(name="force", type=DIMENSIONLESS, low=low)


def position(*members: tuple[str, float]) -> ActuatorField:
    return ActuatorField(name="position", type=Enum("my_position", members))


@pytest.mark.parametrize(
    "actuator",
    [
        lift("move", height(0.0, 400.0)),
        lift("move", height(100.0, 200.0)),
        lift("move"),
        lift("push", force(5.0)),
        lift("go", position(*reversed(POSITIONS))),
        lift("go"),
    ],
)
def test_an_actuator_may_do_less_than_the_command(actuator: Actuator) -> None:
    assert bind(robot(actuators=(actuator,)), (*ROME_SERVERS, LIFT)).actuators[-1].server == "Lift"


TOO_FAR = [
    (
        lift("move", height(-1.0, 400.0)),
        "R008",
        "`lift.height` is -1 to 400 mm, but the command takes 0 to 400 mm",
    ),
    (lift("move", height(0.0, 401.0)), "R008", "is 0 to 401 mm"),
    (lift("move", height(0.0, None)), "R008", "is at least 0 mm"),
    (
        lift("move", height(None, None)),
        "R008",
        "`lift.height` is of any size, but the command takes 0 to 400 mm",
    ),
    (lift("push", force(None)), "R008", "is of any size, but the command takes at least 5"),
    (lift("push"), "R008", "`lift` has no field `force`, which is then 0, but the command takes at least 5"),
    (lift("go", position(("down", 0.0))), "R003", "is my_position, but the command takes position"),
    (
        lift("go", position(("down", 0.0), ("up", 1.0))),
        "R003",
        "is my_position, but the command takes position",
    ),
    (
        lift("go", ActuatorField(name="position", type=DIMENSIONLESS)),
        "R003",
        "is number, but the command takes",
    ),
]


@pytest.mark.parametrize(("actuator", "code", "message"), TOO_FAR)
def test_an_actuator_that_goes_beyond_the_command_is_an_error(
    actuator: Actuator, code: str, message: str
) -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(robot(actuators=(actuator,)), (*ROME_SERVERS, LIFT))
    (found,) = failed.value.diagnostics
    assert found.code == code
    assert message in found.message
    assert found.hint


def test_an_enum_of_a_command_is_told() -> None:
    with pytest.raises(DiagnosticError) as failed:
        bind(robot(actuators=(lift("go", position(("down", 0.0))),)), (*ROME_SERVERS, LIFT))
    assert failed.value.diagnostics[0].hint == "declare an enum with the members down = 0, up = 2"
