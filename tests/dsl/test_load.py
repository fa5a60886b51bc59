"""Whole programs: every construct of the language to the typed program."""

from __future__ import annotations

import pytest

from colony.dsl.load import check_text, load_file, load_text
from colony.ir import expression as e
from colony.ir.program import Let, Machine, Module, PythonModule, State
from colony.ir.types import Array, Bool, Enum, Quantity
from colony.text.diagnostics import DiagnosticError
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension
from tests.dsl.texts import MODULES, ROBOT, expression, findings, named, program

SPEED = Quantity(LENGTH.over(TIME))
TURN = Quantity(ANGLE.over(TIME))


# --- the robot -----------------------------------------------------------------------------------


def test_sensors_in_base_units() -> None:
    robot = program(
        """
        robot r {
          frame 20 ms
          sensor near[8] : m range 0 .. 5 default 2 from PServer.near within 1.5 s
          sensor hot : bool default true from A.b
          sensor turn : rad range -1 rad .. 180 deg from A.in
          sensor kind : goal default goal.light from DServer.kind
          sensor plain : number range -1e3 .. limit from A.c
          sensor scaled : ft range 0 .. limit * 2 from A.d
          sensor area : mm^2 from A.e
          sensor rate : s^-1 from A.f
        }
        enum goal { none = 0, light = 76 }
        param limit = 10
        """,
        robot="",
    ).robot
    near, hot, turn, kind, plain, scaled, area, rate = robot.sensors
    assert robot.name == "r"
    assert robot.frame_ns == 20_000_000
    assert (near.type, near.unit, near.factor) == (Array(Quantity(LENGTH), 8), "m", 1000.0)
    assert (near.low, near.high, near.default, near.within_ns) == (0.0, 5000.0, 2000.0, 1_500_000_000)
    assert (near.server, near.field) == ("PServer", "near")
    assert (hot.type, hot.unit, hot.factor, hot.default, hot.within_ns) == (Bool(), "", 1.0, True, None)
    assert (turn.low, turn.high, turn.field) == (-57.29577951308232, 180.0, "in")
    assert isinstance(kind.type, Enum)
    assert (kind.type.members, kind.default) == ((("none", 0.0), ("light", 76.0)), 76.0)
    assert (plain.low, plain.high, plain.type) == (-1000.0, 10.0, Quantity(NUMBER))
    assert (scaled.low, scaled.high) == (0.0, 20 * 304.8)
    assert area.type == Quantity(Dimension(length=2))
    assert (rate.type, rate.unit) == (Quantity(Dimension(time=-1)), "s^-1")


def test_actuators_in_base_units() -> None:
    drive, lamp, gate = program(
        """
        robot r {
          actuator drive { v : m/s range -0.5 .. 0.5, w : rad/s range -1 .. 1, }
            to RServer.drive idle drive(w = 0 deg/s, v = -10 cm/s) on_loss degrade
          actuator lamp { on : bool, goal : goal } to DServer.Lamp idle hold
          actuator gate { open : bool } to G.g idle gate(open = true) on_loss stop
        }
        enum goal { none = 0, light = 76 }
        """,
        robot="",
    ).robot.actuators
    v, w = drive.fields
    assert (v.name, v.type, v.unit, v.factor, v.low, v.high) == ("v", SPEED, "m/s", 1000.0, -500.0, 500.0)
    assert (w.type, w.high) == (TURN, 57.29577951308232)
    assert drive.idle == (-100.0, 0.0)  # in the order of the fields
    assert (drive.server, drive.command, drive.on_loss) == ("RServer", "drive", "degrade")
    assert (lamp.idle, lamp.on_loss) == (None, "stop")
    assert isinstance(lamp.fields[1].type, Enum)
    assert (gate.idle, gate.on_loss) == ((True,), "stop")


def test_the_frame_period_has_a_default() -> None:
    assert program("", "robot r { }").robot.frame_ns == 50_000_000


# --- derived values ------------------------------------------------------------------------------


def test_enums_and_params_read_what_is_above_them() -> None:
    value = expression("far", "param near = 2 m param far = near * 2 + 1 m")
    assert isinstance(value, e.Constant)
    assert (value.type, value.value) == (Quantity(LENGTH), 5000.0)
    assert findings("enum g { a = k }\nparam k = 3") == ["1:14 E105"]
    assert findings("param k = 3 enum g { a = k }") == []


def test_params_may_be_read_above_their_declaration_by_all_but_constants() -> None:
    assert named(Let, "a", "let a = p\nparam p = 3").expression == e.Constant(type=Quantity(), value=3.0)


def test_lets_in_order() -> None:
    whole = program("let a = sonar[0]\nlet b = a + 1 mm\nstate s = 0\nlet c = s")
    assert [d.name for d in whole.derived] == ["a", "b", "c", "s"]
    b = whole.derived[1]
    assert isinstance(b, Let)
    assert b.expression == e.BinaryOperation(
        type=Quantity(LENGTH),
        operator=e.Binary.ADD,
        left=e.DerivedValue(type=Quantity(LENGTH), name="a"),
        right=e.Constant(type=Quantity(LENGTH), value=1.0),
    )


@pytest.mark.parametrize(
    ("text", "type_", "initial"),
    [
        ("state s = 0", Quantity(), 0.0),
        ("state s = 3 m", Quantity(LENGTH), 3000.0),
        ("state s : m = 3 m", Quantity(LENGTH), 3000.0),
        ("state s : deg = 0", Quantity(ANGLE), 0.0),
        ("state s = true", Bool(), True),
        ("state s : bool = false", Bool(), False),
        ("state s : number = 2 * 3", Quantity(), 6.0),
        ("state s = -0.5 s", Quantity(TIME), -0.5),
    ],
)
def test_states(text: str, type_: object, initial: object) -> None:
    state = named(State, "s", text)
    assert (state.type, state.initial, state.next) == (type_, initial, None)


def test_a_state_of_an_enum_and_its_next() -> None:
    state = named(State, "s", "enum g { a = 1, b = 5 }\nstate s = g.b\nnext s = if bumper then g.a else s")
    assert state.initial == 5.0
    assert isinstance(state.next, e.Conditional)
    assert state.next.no == e.StateValue(type=state.type, name="s")


def test_a_machine() -> None:
    machine = named(
        Machine,
        "mode",
        """machine mode {
             start idle
             idle -> busy when bumper
             any -> idle when elapsed(mode == mode.busy) >= 3 s
             busy -> done when recently(bumper, 1 s)
           }""",
    )
    assert machine.type.members == (("idle", 0.0), ("busy", 1.0), ("done", 2.0))
    assert machine.type.kind == "machine"
    assert machine.start == 0.0
    first, second, third = machine.transitions
    assert (first.sources, first.target) == ({0.0}, 1.0)
    assert (second.sources, second.target) == ({1.0, 2.0}, 0.0)  # every phase but the target
    assert (third.sources, third.target) == ({1.0}, 2.0)
    assert isinstance(third.condition, e.MemoryCall)
    assert third.condition.duration_ns == 1_000_000_000


def test_a_phase_may_be_held_in_a_state() -> None:
    text = "machine mode { start one one -> two when bumper }\nstate former = mode.two\nnext former = mode"
    assert named(State, "former", text).initial == 1.0


# --- modules -------------------------------------------------------------------------------------


def test_a_module() -> None:
    module = named(
        Module,
        "avoid",
        """module avoid {
             param clearance = 600 mm
             let   near = min(sonar[11..13])
             state bumps = 0
             next  bumps = bumps + 1
             param far = clearance * 2
             when  near < far
             do    drive(turn = if near < clearance then 30 deg/s else 0, velocity = 8 cm/s)
           }""",
    )
    assert module.params == (("clearance", 600.0), ("far", 1200.0))
    assert [let.name for let in module.lets] == ["avoid.near"]
    [state] = module.states
    assert (state.name, state.initial) == ("avoid.bumps", 0.0)
    assert state.next is not None
    assert module.command.actuator == module.actuator == "drive"
    assert module.command.fields[0] == e.Constant(type=SPEED, value=80.0)  # in the order of the actuator
    assert module.command.fields[1].type == TURN
    near = e.LocalValue(type=Quantity(LENGTH), name="avoid.near")
    far = e.Constant(type=Quantity(LENGTH), value=1200.0)
    assert module.when == e.BinaryOperation(type=Bool(), operator=e.Binary.LESS, left=near, right=far)


def test_a_module_without_a_command() -> None:
    module = named(Module, "blind", "module blind { when not fresh(sonar) }")
    assert module.command is None
    assert module.actuator is None


def test_a_modules_own_names_hide_those_of_the_file() -> None:
    text = (
        "let a = 1\nstate b = true\nmodule m { let a = bumper state b = 3 mm next b = b when a and b > 2 mm }"
    )
    module = named(Module, "m", text)
    assert [let.expression for let in module.lets] == [e.SensorValue(type=Bool(), name="bumper")]
    assert isinstance(module.when, e.BinaryOperation)
    assert module.when.left == e.LocalValue(type=Bool(), name="m.a")


def test_above_its_own_let_a_module_reads_the_files() -> None:
    module = named(Module, "m", "let a = 1\nmodule m { let b = a let a = a + b when a > b }")
    assert module.lets[0].expression == e.DerivedValue(type=Quantity(), name="a")


def test_a_python_module() -> None:
    module = named(
        PythonModule,
        "center",
        """let ahead = min(sonar)
           state laps = 0
           machine mode { start one one -> two when bumper }
           module center from python "colony.nav.hallway:CenterHallway" {
             param width = 3.6 m
             param half = width / 2
             param fast = true
             reads sonar, heading, ahead
             reads laps, mode
             commands drive
             rate 300 ms
           }""",
    )
    assert (module.module_path, module.class_name) == ("colony.nav.hallway", "CenterHallway")
    assert module.params == (("width", 3600.0), ("half", 1800.0), ("fast", True))
    assert [r.name for r in module.reads] == ["sonar", "heading", "ahead", "laps", "mode"]
    assert (module.actuator, module.rate_ns) == ("drive", 300_000_000)


def test_a_python_module_that_only_watches() -> None:
    module = named(PythonModule, "m", 'module m from python "a:B" { }')
    assert (module.reads, module.actuator, module.rate_ns, module.params) == ((), None, None, ())


# --- limits, contracts, tests --------------------------------------------------------------------


def test_limits_in_the_order_written() -> None:
    first, second = program(
        "limit drive.turn >= -10 deg/s\nlimit drive.velocity <= 100 mm/s when sonar[12] < 1 m"
    ).limits
    assert (first.actuator, first.field_index, first.relation, first.condition) == ("drive", 1, ">=", None)
    assert (second.field_index, second.relation) == (0, "<=")
    assert second.condition is not None
    assert second.bound == e.Constant(type=SPEED, value=100.0)


def test_what_contracts_say() -> None:
    def said(text: str) -> e.Expression:
        [contract] = program(f"{MODULES}\ncontract c: {text}").contracts
        return contract.expression

    assert said("drive by avoid") == e.WonBy(type=Bool(), actuator="drive", module="avoid")
    assert said("drive is commanded") == e.IsCommanded(type=Bool(), actuator="drive")
    assert said("drive is idle") == e.IsIdle(type=Bool(), actuator="drive")
    assert said("roam is active") == e.IsActive(type=Bool(), name="roam")
    assert said("blind is active") == e.IsActive(type=Bool(), name="blind")
    assert said("lamp.on") == e.SentField(type=Bool(), actuator="lamp", field_index=0)
    velocity = e.SentField(type=SPEED, actuator="drive", field_index=0)
    zero = said("drive.velocity <= 0")
    assert isinstance(zero, e.BinaryOperation)
    assert zero.left == velocity
    local = said("avoid.near < avoid.clearance and avoid.bumps == 0")
    assert isinstance(local, e.BinaryOperation)
    assert isinstance(local.left, e.BinaryOperation)
    assert local.left.left == e.LocalValue(type=Quantity(LENGTH), name="avoid.near")
    assert local.left.right == e.Constant(type=Quantity(LENGTH), value=600.0)
    assert isinstance(local.right, e.BinaryOperation)
    assert local.right.left == e.StateValue(type=Quantity(), name="avoid.bumps")


@pytest.mark.parametrize("value", ["enum nav { go = 1 }", "machine nav { start go }"])
def test_a_contract_tells_a_module_from_a_value_of_its_name(value: str) -> None:
    module = "module nav { param go = 7 param k = 3 when bumper do drive(velocity = 0, turn = 0) }"
    [c] = program(f"{value} {module} contract c: nav.k == 3 and nav.go != nav.go").contracts
    assert isinstance(c.expression, e.BinaryOperation)
    left, right = c.expression.left, c.expression.right
    assert isinstance(left, e.BinaryOperation)
    assert isinstance(right, e.BinaryOperation)
    assert left.left == e.Constant(type=Quantity(NUMBER), value=3.0)
    assert isinstance(right.left.type, Enum)


def test_an_example() -> None:
    [example] = program(
        MODULES
        + """test "everything" {
          at 0 s     given sonar = 3 m, bumper = true, heading = 1 rad, docked_at = -2 * 3
                     expect drive by avoid, drive.velocity < 0
          at 100 ms  given sonar[12] = 400, sonar = missing
          from 1 s to 1.25 s every 100 ms  expect drive is idle
          at 2 s     given infrared = [true, false, true, false, true, false, true, false, true, false, true,
                     false, true, false, true, false, true, false, true, false, true, false, true, false]
        }"""
    ).tests
    assert example.name == "everything"
    first, second, third, fourth = example.steps
    assert first.times_ns == (0,)
    assert [(g.sensor, g.index, g.value) for g in first.given] == [
        ("sonar", None, 3000.0),
        ("bumper", None, True),
        ("heading", None, 57.29577951308232),
        ("docked_at", None, -6.0),
    ]
    assert len(first.expectations) == 2
    assert [(g.sensor, g.index, g.value) for g in second.given] == [
        ("sonar", 12, 400.0),
        ("sonar", None, None),
    ]
    assert third.times_ns == (1_000_000_000, 1_100_000_000, 1_200_000_000)
    assert fourth.given[0].value == (True, False) * 12


def test_the_end_of_a_step_is_in() -> None:
    [example] = program('test "t" { from 0 s to 1 s every 500 ms  from 2 s to 2 s every 1 s }').tests
    assert [s.times_ns for s in example.steps] == [(0, 500_000_000, 1_000_000_000), (2_000_000_000,)]


def test_each_memory_call_has_a_cell_of_its_own() -> None:
    whole = program(
        """let a = recently(bumper, 1 s) and rising(bumper)
           module m { when changed(bumper) do drive(velocity = 0, turn = 0) }
           module n = m
           contract c: latch(bumper, not bumper)"""
    )
    cells: list[int] = []
    a, contract = whole.derived[0], whole.contracts[0]
    assert isinstance(a, Let)
    stack: list[e.Expression] = [a.expression, contract.expression]
    stack += [m.when for m in whole.modules if isinstance(m, Module)]
    while stack:
        here = stack.pop()
        stack += e.children(here)
        cells += [here.cell] if isinstance(here, e.MemoryCall) else []
    assert len(cells) == len(set(cells)) == 5


# --- the front door ------------------------------------------------------------------------------


def test_load_text_raises_everything_that_was_found() -> None:
    with pytest.raises(DiagnosticError) as caught:
        load_text("let a = b\nlet c = d" + ROBOT)
    assert [d.code for d in caught.value.diagnostics] == ["E101", "E101"]


def test_load_file_raises(tmp_path: object) -> None:
    with pytest.raises(DiagnosticError, match="E001"):
        load_file(f"{tmp_path}/nothing.colony")


def test_there_is_no_program_where_there_are_errors() -> None:
    assert check_text("let a = b" + ROBOT).program is None


def test_places_are_those_of_the_text() -> None:
    [a, *_] = program("\n\n  let ahead = 3").derived
    assert repr(a.span) == "<text>:3:7"
    assert a.span.text == "ahead"
