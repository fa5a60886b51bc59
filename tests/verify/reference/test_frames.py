"""Sensors, modules, wiring, limits, contracts and what is sent, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.dsl.load import load_text
from colony.ir.expression import Constant
from colony.ir.frame import Decision, Frame, Outcome, Reading, Record
from colony.ir.program import Chain, Module, Program, Use, Wire
from colony.ir.types import BOOL
from colony.verify.reference.interpreter import Interpreter
from tests.verify.stepping import MS, ROBOT, Shot, every, program, run, value, values, winners

T, F = True, False
NAN, INF = math.nan, math.inf

# --- sensors -------------------------------------------------------------------------------------

SENSORS = """
enum mood { calm = 0, alert = 67 }
robot r {
  sensor flag : bool from DServer.a
  sensor far : m range -1 .. 5 from DServer.far
  sensor three[3] : cm range 0 .. 100 default 7 from DServer.three
  sensor feel : mood default mood.alert from DServer.feel
  sensor free : number from DServer.free
}
"""


def sensed(name: str, reading: Reading) -> tuple[object, list[Record]]:
    """What `name` is in a frame with this reading, and what was recorded."""
    of = load_text(SENSORS + f"let it = {name}\nlet there = fresh({name})")
    interpreter = Interpreter(of)
    outcome = interpreter.step(Frame(0, {name: reading}))
    assert interpreter._moment is not None
    return interpreter._moment.derived.get("it"), list(outcome.records)


@pytest.mark.parametrize(
    ("name", "reading", "expected"),
    [
        ("flag", True, T),
        ("far", 2, 2000.0),  # an int is a number; meters become millimeters
        ("far", 5.0, 5000.0),
        ("three", [1, 2.0, 3], (10.0, 20.0, 30.0)),
        ("three", (1, 2, 3), (10.0, 20.0, 30.0)),
        ("feel", 67, 67.0),
        ("free", INF, INF),  # no range to be outside of
        ("free", -0.0, -0.0),
        ("far", None, None),
        ("three", None, (7 * 10.0,) * 3),
    ],
)
def test_a_reading(name: str, reading: Reading, expected: object) -> None:
    assert repr(sensed(name, reading)) == repr((expected, []))


@pytest.mark.parametrize(
    ("name", "reading", "expected"),
    [
        ("flag", 1, None),
        ("flag", "yes", None),
        ("far", True, None),
        ("far", NAN, None),
        ("far", "2", None),
        ("far", (2.0,), None),
        ("three", (1, 2), (70.0,) * 3),
        ("three", 1.0, (70.0,) * 3),
        ("three", (1, 2, NAN), (70.0,) * 3),  # one bad element spoils the array
        ("three", (1, 2, True), (70.0,) * 3),
        ("three", "abc", (70.0,) * 3),
        ("feel", 66.0, 67.0),
        ("feel", NAN, 67.0),
    ],
)
def test_a_fault_is_recorded_and_the_sensor_missing_or_at_its_default(
    name: str, reading: Reading, expected: object
) -> None:
    assert repr(sensed(name, reading)) == repr((expected, [Record("sensor fault", name)]))


@pytest.mark.parametrize(
    ("name", "reading", "expected"),
    [
        ("far", 5.5, 5000.0),
        ("far", -2, -1000.0),
        ("far", INF, 5000.0),
        ("far", -INF, -1000.0),
        ("far", 10**400, 5000.0),
        ("three", (1, 200, -3), (10.0, 1000.0, 0.0)),
    ],
)
def test_what_is_outside_the_range_is_clamped_and_recorded(
    name: str, reading: Reading, expected: object
) -> None:
    assert sensed(name, reading) == (expected, [Record("sensor clamped", name)])


def test_a_default_is_not_fresh() -> None:
    of = load_text(SENSORS + "let it = fresh(feel)\nlet read = feel\nlet there = fresh(read)")
    interpreter = Interpreter(of)
    found = []
    for t, readings in enumerate(({"feel": 0}, {}, {"feel": 5})):
        interpreter.step(Frame(t, readings))
        assert interpreter._moment is not None
        found.append((interpreter._moment.derived["it"], interpreter._moment.derived["there"]))
    assert found == [(T, T), (F, T), (F, T)]


def test_base_units_are_taken_as_they_are() -> None:
    of = load_text(SENSORS + "let it = far")
    interpreter = Interpreter(of)
    outcome = interpreter.step_in_base_units(0, {"far": 2.0, "three": [0.1, 1000, 1001]})
    assert interpreter._moment is not None
    assert interpreter._moment.sensors["far"] == 2.0
    assert interpreter._moment.sensors["three"] == (0.1, 1000.0, 1000.0)
    assert outcome.records == (Record("sensor clamped", "three"),)


def test_records_of_sensors_stand_in_the_order_declared() -> None:
    outcome = Interpreter(load_text(SENSORS)).step(Frame(0, {"free": NAN, "far": 9, "flag": 3}))
    expected = [("sensor fault", "flag"), ("sensor clamped", "far"), ("sensor fault", "free")]
    assert list(outcome.records) == expected


# --- modules -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "module",
    [
        "when x > 0 or true do out(v = 1)",
        "when true do out(v = x)",
        "let unused = x when true do out(v = 1)",
        "state n = 0 next n = x when true do out(v = 1)",
        "let it = rising(x > 0) when true do out(v = 1)",
    ],
)
def test_anything_missing_that_a_module_reads_makes_it_silent(module: str) -> None:
    text = f"module m {{ {module} }}\nnetwork {{ out = m }}"
    assert winners(text, (0, {"x": 1.0}), (1, {})) == ["m", None]


def test_a_silent_module_neither_suppresses_nor_inhibits() -> None:
    text = """
      module silent { when x > 0 or true }
      module other { when x > 0 or true do out(v = 1) }
      module it { when true do out(v = 2) }
      network { out = silent inhibits (other suppresses it) }
    """
    assert winners(text, (0, {"x": 1.0}), (1, {})) == [None, "it"]


# --- network -------------------------------------------------------------------------------------

MODULES = """
module ma { when a do out(v = 1) }
module mb { when b do out(v = 2) }
module mc { when c do out(v = 3) }
module na { when a }
"""


def wired(wiring: str, *shots: Shot) -> str:
    """The winners as one character a frame: a, b, c, or `-`."""
    return "".join("-" if w is None else w[1] for w in winners(MODULES + f"network {{ {wiring} }}", *shots))


ALL = every(50, a="00001111", b="00110011", c="01010101")


@pytest.mark.parametrize(
    ("wiring", "expected"),
    [
        ("out = ma suppresses mb", "--bbaaaa"),
        ("out = ma inhibits mb", "--bb----"),
        ("out = ma suppresses mb suppresses mc", "-cbbaaaa"),
        ("out = ma inhibits mb inhibits mc", "-c------"),
        ("out = (ma inhibits mb) inhibits mc", "-c---c-c"),
        ("out = na inhibits (mb suppresses mc)", "-cbb----"),
        ("out = (na inhibits mb) suppresses mc", "-cbb-c-c"),
        ("out = (ma suppresses mb) inhibits mc", "-c------"),
        ("w = mb suppresses mc  out = (na inhibits w) suppresses w", "-cbb-cbb"),
        ("w = na inhibits mb  out = w inhibits mc", "-c---c-c"),
        ("out = ma inhibits ma", "--------"),
        ("out = ma suppresses ma", "----aaaa"),
    ],
)
def test_wiring(wiring: str, expected: str) -> None:
    assert wired(wiring, *ALL) == expected


@pytest.mark.parametrize(
    ("wiring", "a", "expected"),
    [
        # b is always active; frames 50 ms apart
        ("out = ma suppresses[100 ms] mb", "0100010", "ba-bba-"),
        ("out = ma inhibits[100 ms] mb", "0100010", "b--bb--"),
        ("out = ma suppresses[101 ms] mb", "0100000", "ba--bbb"),
        ("out = ma suppresses[50 ms] mb", "0100000", "babbbbb"),
        ("out = ma inhibits[1 ms] mb", "0100000", "b-bbbbb"),
        # the window of one node is its own: shared A, two nodes
        ("w = ma suppresses[100 ms] mb  out = w suppresses mb", "0100", "babb"),
    ],
)
def test_time_constants(wiring: str, a: str, expected: str) -> None:
    assert wired(wiring, *every(50, a=a, b="1" * len(a), c="0" * len(a))) == expected


def test_a_time_constant_ends_at_the_very_nanosecond() -> None:
    one_ns = 1e-6
    there: dict[str, Reading] = {"a": F, "b": T, "c": F}
    shots = [(0, {**there, "a": T}), (100 - one_ns, there), (100, there)]
    assert wired("out = ma suppresses[100 ms] mb", *shots) == "a-b"


def test_a_window_moves_on_where_its_node_does_not_get_through() -> None:
    rows = every(50, a="0100", b="1111", c="0100")
    assert wired("out = mc suppresses (ma suppresses[100 ms] mb)", *rows) == "bc-b"


def test_a_window_moves_on_while_a_module_in_it_is_silent() -> None:
    assert wired("out = ma suppresses[100 ms] mb", *every(50, a="1..", b="1.1", c="000")) == "a-b"


def test_a_chain_of_ten_thousand() -> None:
    of = program(
        "module ma { when a do out(v = 1) } module mb { when b do out(v = 2) }\nnetwork { out = mb }"
    )
    uses = (*(Use(name="ma") for _ in range(10_000)), Use(name="mb"))
    chain = Chain(relation="suppresses", operands=uses, windows_ns=(0,) * 10_000)
    long = replace(of, wires=(Wire(name="out", wiring=chain, actuator="out"),))
    assert [o.decisions[0].by for o in run(long, *every(50, a="01", b="11"))] == ["mb", "ma"]


def test_ten_thousand_wires_in_a_row() -> None:
    of = program(
        "module ma { when a do out(v = 1) } module mb { when b do out(v = 2) }\nnetwork { out = mb }"
    )
    wires = [Wire(name="w0", wiring=Use(name="mb"))]
    for i in range(1, 10_000):
        link = Chain(relation="suppresses", operands=(Use(name="ma"), Use(name=f"w{i - 1}")), windows_ns=(0,))
        wires.append(Wire(name=f"w{i}", wiring=link))
    wires.append(Wire(name="out", wiring=Use(name="w9999"), actuator="out"))
    assert [o.decisions[0].by for o in run(replace(of, wires=tuple(wires)), *every(50, a="01", b="11"))] == [
        "mb",
        "ma",
    ]


# --- what is sent --------------------------------------------------------------------------------


def base(text: str, *shots: Shot) -> list[tuple[Decision, tuple[Record, ...]]]:
    """Decisions of `base` and records, for a module `m` that drives it."""
    return [(o.decisions[1], o.records) for o in run(text + "\nnetwork { base = m }", *shots)]


def test_commands_leave_in_declared_units() -> None:
    [(decision, records)] = base("module m { when true do base(turn = 1 rad/s, speed = 500 mm/s) }", (0, {}))
    assert decision == Decision("base", "m", (0.5, 57.29577951308232))
    assert records == ()


def test_nobody_commands() -> None:
    [outcome] = run("module m { when false do base(speed = 0, turn = 0) }\nnetwork { base = m }", (0, {}))
    assert outcome == Outcome((Decision("out", None, None), Decision("base", None, (0.0, 0.0))))


def test_an_actuator_without_wiring_is_idle() -> None:
    [outcome] = run("", (0, {}))
    assert [d.by for d in outcome.decisions] == [None, None]


def test_a_command_outside_the_range_is_clamped_and_recorded() -> None:
    [(decision, records)] = base("module m { when true do base(speed = 2 m/s, turn = 999 deg/s) }", (0, {}))
    assert decision.values == (1.0, 999.0)
    assert records == (Record("command clamped", "base.speed"),)


@pytest.mark.parametrize("x", [0.0, -0.0])
def test_a_command_that_is_not_finite_is_never_sent(x: float) -> None:
    text = "module m { when true do base(speed = 1 m/s / x, turn = 0) }\nlimit base.speed <= 0.2 m/s"
    [(decision, records)] = base(text, (0, {"x": x}))
    assert decision == Decision("base", "m", (0.0, 0.0), "not finite")
    assert records == (Record("not finite", "m"),)


def test_a_command_that_overflows_on_its_way_out_is_not_sent_either() -> None:
    text = """
      robot r {
        actuator clock { period : ms } to DServer.clock idle hold
      }
      module m { when true do clock(period = 1.7e308 s) }
      network { clock = m }
    """
    [outcome] = run(load_text(text), (0, {}))
    assert outcome.decisions == (Decision("clock", "m", None, "not finite"),)
    assert outcome.records == (Record("not finite", "m"),)


def test_limits_stand_before_the_range_and_are_recorded_once_a_field() -> None:
    text = """
      module m { when true do base(speed = 5 m/s, turn = -50 deg/s) }
      limit base.turn >= -20 deg/s
      limit base.speed <= 3 m/s
      limit base.speed <= 2 m/s
    """
    [(decision, records)] = base(text, (0, {}))
    assert decision.values == (1.0, -20.0)
    assert records == (
        Record("limited", "base.speed"),
        Record("command clamped", "base.speed"),
        Record("limited", "base.turn"),
    )


def test_several_limits_apply_in_the_order_written() -> None:
    text = "module m { when true do base(speed = 0.5 m/s, turn = 0) }\n"
    up, down = "limit base.speed >= 0.3 m/s\n", "limit base.speed <= 0.1 m/s\n"
    assert base(text + up + down, (0, {}))[0][0].values == (0.1, 0.0)
    assert base(text + down + up, (0, {}))[0][0].values == (0.3, 0.0)


@pytest.mark.parametrize(
    ("limit", "shots", "speeds"),
    [
        ("<= 0.1 m/s when a", every(50, a="01."), [0.5, 0.1, 0.1]),  # missing counts as true
        ("<= x * 1 m/s", [(0, {"x": 0.2}), (1, {}), (2, {"x": INF}), (3, {"x": 9.0})], [0.2, 0.0, 0.0, 0.5]),
        ("<= x * 1 m/s when a", [(0, {"a": F}), (1, {"a": F, "x": 0.2})], [0.0, 0.5]),  # of anything in it
        ("<= x * 1 m/s when a", [(0, {"x": 0.2})], [0.2]),
        ("<= 0.1 m/s when not changed(a)", every(50, a="01.1"), [0.1, 0.5, 0.1, 0.1]),
        ("<= 0.1 m/s when every(100 ms)", every(50, a="0000"), [0.1, 0.5, 0.1, 0.5]),
    ],
)
def test_a_limit(limit: str, shots: list[Shot], speeds: list[float]) -> None:
    text = f"module m {{ when true do base(speed = 0.5 m/s, turn = 0) }}\nlimit base.speed {limit}"
    assert [d.values[0] if d.values else None for d, _ in base(text, *shots)] == pytest.approx(speeds)


def test_memory_of_a_limit_moves_on_while_nobody_commands() -> None:
    text = """
      module m { when b do base(speed = 0.5 m/s, turn = 0) }
      limit base.speed <= 0.1 m/s when previous(a, false)
    """
    assert [d.values for d, _ in base(text, *every(50, a="10", b="01"))] == [(0.0, 0.0), (0.1, 0.0)]


def test_idle_commands_are_not_limited() -> None:
    moving = ROBOT.replace("idle base(speed = 0", "idle base(speed = 0.9 m/s")
    text = moving + "limit base.speed <= 0.1 m/s"
    [outcome] = run(load_text(text), (0, {}))
    assert outcome.decisions[1].values == (0.9, 0.0)
    assert outcome.records == ()


# --- contracts -----------------------------------------------------------------------------------


def breaches(contract: str, *shots: Shot, text: str = "") -> list[bool]:
    """Whether the contract is broken in each frame; `m` drives `base` where a, `n` drives `out` where b."""
    modules = """
      module m {
        param gain = 3
        let fast = x > gain
        state n = 0
        next n = n + 1
        when a do base(speed = x * 1 m/s, turn = 0)
      }
      module n { when b do out(v = x) }
      network { top = m  base = top  out = n }
    """
    return ["it" in o.breaches for o in run(f"{modules}\n{text}\ncontract it: {contract}", *shots)]


ON: dict[str, Reading] = {"a": T, "b": T, "x": 0.5}
OFF: dict[str, Reading] = {"a": F, "b": F, "x": 0.5}


@pytest.mark.parametrize(
    ("contract", "when_on", "when_off"),
    [
        ("false", T, T),
        ("base by m", F, T),
        ("base is commanded", F, T),
        ("base is idle", T, F),
        ("m is active", F, T),
        ("top is active", F, T),
        ("base.speed > 0", F, T),  # the idle command has a speed
        ("base.speed == 500 mm/s", F, T),
        ("out.v == 99", T, F),  # `idle hold`: nothing was sent, so it says nothing
        ("out is idle", T, F),
        ("m.gain == 3", F, F),
        ("m.fast", T, T),
    ],
)
def test_a_contract(contract: str, when_on: bool, when_off: bool) -> None:
    assert breaches(contract, (0, ON)) == [when_on]
    assert breaches(contract, (0, OFF)) == [when_off]


def test_contracts_see_what_is_sent_after_limits_and_range() -> None:
    fast: dict[str, Reading] = {**ON, "x": 7.0}
    assert breaches("base.speed <= 1 m/s", (0, fast)) == [F]
    assert breaches("base.speed <= 300 mm/s", (0, fast), text="limit base.speed <= 0.3 m/s") == [F]


def test_a_winner_that_is_not_finite_wins_but_does_not_command() -> None:
    bad: dict[str, Reading] = {**ON, "x": INF}
    assert breaches("base by m and base is idle and m is active and base.speed == 0", (0, bad)) == [F]
    assert breaches("base is commanded", (0, bad)) == [T]


def test_what_reads_something_missing_says_nothing() -> None:
    assert breaches("x > 100", (0, {}), (1, {"x": 0.0})) == [F, T]
    assert breaches("m.fast", (0, {"x": 1.0}), (1, {"x": 1.0, "a": F})) == [F, T]  # m was silent


def test_states_in_contracts_show_old_values_and_are_never_missing() -> None:
    assert breaches("m.n == 0", (0, OFF), (1, {}), (2, OFF), (3, OFF)) == [F, T, T, T]
    assert breaches("m.n == 1", (0, OFF), (1, {}), (2, OFF), (3, OFF)) == [T, F, F, T]


def test_memory_of_a_contract_moves_on_where_all_it_reads_is_there() -> None:
    assert breaches("not previous(a, false)", *every(50, a="10.0", x="0000")) == [F, T, F, F]


def test_breaches_stand_in_the_order_written() -> None:
    [outcome] = run("contract z: false\ncontract y: true\ncontract x2: 1 > 2", (0, {}))
    assert outcome.breaches == ("z", "x2")


# --- a program as a whole ------------------------------------------------------------------------


def test_times_may_be_any_that_rise() -> None:
    of = program("module m { when held(a, 100 ms) do out(v = now() / 1 s) }\nnetwork { out = m }")
    interpreter = Interpreter(of)
    found = [
        interpreter.step(Frame(t, {"a": a})).decisions[0].values
        for t, a in ((-7, T), (100 * MS - 8, F), (100 * MS - 7, F))
    ]
    assert found == [(0.0,), ((100 * MS - 1) / 1e9,), None]


def test_a_program_without_anything() -> None:
    assert run(load_text("robot r { }"), (0, {"x": 1.0})) == [Outcome(())]


def test_a_hand_built_program_needs_no_text() -> None:
    always = Module(name="m", when=Constant(type=BOOL, value=True))
    of = replace(program(""), modules=(always,))
    assert isinstance(of, Program)
    assert Interpreter(of).step(Frame(0, {})).breaches == ()


def test_helpers_agree() -> None:
    assert value("x + 1", x=1.0) == 2.0
    assert values("x", (0, {}), (1, {"x": 2.0})) == [None, 2.0]
