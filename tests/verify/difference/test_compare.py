"""What counts as the same behavior, and the shortest runs that tell others apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from colony.dsl.load import load_file, load_text
from colony.verify.difference import DifferenceUndecided, Different, Same, difference
from colony.verify.difference.content import contents
from colony.verify.difference.report import lines
from tests.diagnostics import problems_of
from tests.paths import BEHAVIORS, ROOT
from tests.sampling import sampled
from tests.verify.difference.programs import QUICK, ROBOT, compare, program, verdict
from tests.verify.small_robot import go

CRUISE = go("cruise", "true")
AVOID = go("avoid", "sonar < 1 m", "80 mm/s", "30 deg/s")
ROAM = CRUISE + AVOID + "network { drive = avoid suppresses cruise }"


# --- the same --------------------------------------------------------------------------------------


def test_modules_with_other_names_in_another_order() -> None:
    other = go("dodge", "sonar < 1 m", "80 mm/s", "30 deg/s") + go("ahead", "true")
    result = compare(ROAM, other + "network { roam = dodge suppresses ahead drive = roam }")
    assert isinstance(result, Same)
    assert result.by_content
    assert result.matching.same == (("cruise", "ahead"), ("avoid", "dodge"))


def test_a_let_in_place_of_what_it_stands_for() -> None:
    let = "let near = sonar < 1 m\n" + ROAM.replace("when sonar < 1 m", "when near")
    result = compare(ROAM, let)
    assert isinstance(result, Same)
    assert result.by_content


def test_predicates_that_say_the_same_in_other_words() -> None:
    result = compare(ROAM, ROAM.replace("sonar < 1 m", "not (sonar >= 1000 mm)"))
    assert isinstance(result, Same)
    assert not result.by_content
    assert result.matching.changed == ("avoid",)


def test_suppression_is_associative_and_inhibitors_commute() -> None:
    parts = AVOID + CRUISE + go("back", "bumper", "-100 mm/s") + "module i { when level > 5 }\n"
    parts += "module j { when level > 7 }\n"
    one = parts + "network { drive = i inhibits j inhibits (back suppresses avoid suppresses cruise) }"
    other = parts + "network { drive = j inhibits i inhibits ((back suppresses avoid) suppresses cruise) }"
    result = compare(one, other)
    assert isinstance(result, Same)
    assert result.over_reals == ()


def test_what_is_the_same_where_no_float_rounds_is_the_same_over_reals() -> None:
    one = ROAM.replace("sonar < 1 m", "(sonar + 1 m) + 2 m < 4 m")
    other = ROAM.replace("sonar < 1 m", "sonar + (1 m + 2 m) < 4 m")
    head, places, _ = lines(program(one), program(other), compare(one, other))
    assert head.startswith("the same over reals: in every frame")
    assert places == "  floats may round at <text>:11"


def test_an_inhibitor_is_a_suppressor_that_stands_still() -> None:
    one = CRUISE + "module docked { when level > 5 }\nnetwork { drive = docked inhibits cruise }"
    other = CRUISE + go("docked", "level > 5", "0") + "network { drive = docked suppresses cruise }"
    assert verdict(one, other) == "Same"
    assert verdict(one, other.replace("velocity = 0", "velocity = 1 mm/s")) == "Different"


def test_memory_that_is_kept_otherwise() -> None:
    one = "state seen = false\nnext seen = seen or bumper\n" + go("a", "seen or bumper")
    other = go("a", "latch(bumper, false)")
    network = "network { drive = a }"
    # The module is silent without `bumper`; with the state alone it would not be, but it reads it, too.
    assert verdict(one + network, other + network) == "Same"


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=4), ids=lambda p: p.stem)
def test_every_behavior_is_the_same_as_itself(path: Path) -> None:
    one = load_file(path)
    if any(w.actuator for w in one.wires):
        result = difference(one, load_file(path))
        assert isinstance(result, Same)
        assert result.by_content


# --- the same content in another form ----------------------------------------------------------------

RING = """
language 1
robot r {
  sensor ring[8] : mm  bearing -180 deg  range 0 .. 5000  from PServer.ring
  sensor turned : deg from RServer.turned
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
"""


def is_same_content(one: str, other: str) -> bool:
    """Whether the values of two expressions have the same content; it is not asked whether they are equal."""
    a, b = (load_text(f"{RING}{text}") for text in (one, other))
    of_a, of_b = contents(a, b)
    return of_a.derived(a.derived[-1]) == of_b.derived(b.derived[-1])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("let v = min(ring[3..5])", "let v = min(ring[-45 deg .. 45 deg])"),
        ("let v = min(ring[3..5])", "let v = min(r for r in ring[-45 deg .. 45 deg])"),
        ("let v = min(ring[3..5])", "let v = min(ring[k + 4] for k in -1 .. 1)"),
        ("let v = min(ring[3..5])", "let v = min(r for r, a in ring if abs(a) <= 45 deg)"),
        ("let v = ring[7] + ring[0] + ring[1]", "let v = sum(ring[135 deg .. -135 deg])"),
        ("let v = sum(sin(k * 45 deg) * ring[4 + k] for k in -2 .. 2)",
         "let v = sum(sin(a) * r for r, a in ring[-90 deg .. 90 deg])"),
        ("let v = if bumper then -20 else 20",
         "let p(b : bool, n : number) = if b then -n else n let v = p(bumper, 20)"),
        ("let v = recently(ring[4] < 1 m, 1 s)",
         "let near = ring[0 deg] < 1000 mm let v = recently(near, 1 s)"),
        ("let v = count(previous(ring, 0 mm)[3..4] < 1 m)",
         "let v = count(previous(ring[k], 0 mm) < 1 m for k in 3 .. 4)"),
        ("let v = value_or(ring[4], 1 m)", "let v = value_or(ring[0 deg], 1 m)"),
        ("let v = index_of_min(ring[3..5])", "let side = ring let v = index_of_min(side[-45 deg .. 45 deg])"),
    ],
)  # fmt: skip
def test_the_same_content(one: str, other: str) -> None:
    assert is_same_content(one, other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("let v = sum(ring[3..5])", "let v = ring[3] + (ring[4] + ring[5])"),
        ("let v = sum(ring[3..5])", "let v = sum(ring[5 - k] for k in 0 .. 2)"),
        ("let v = 0 * turned", "let v = -0.0 * turned"),
        ("let v = 1", "let v = true"),
        ("let v = if bumper then 1 else 1", "let v = 1"),  # missing without the bumper
        ("let v = min(1 for k in 0 .. 0 if k == 0 or bumper)", "let v = 1"),
        ("let v = value_or(recently(bumper, 1 s), false)", "let v = recently(bumper, 1 s)"),
        ("let v = recently(bumper, 1 s)", "let v = recently(bumper, 1 s) and turned == turned"),
        ("let v = index_of_min(window(ring, turned / 1 deg, 1))",
         "let w = window(ring, turned / 1 deg, 1) let v = index_of_min(w)"),
        ("let v = index_of_min(ring[3..5])", "let side = ring[3..5] let v = index_of_min(side)"),
        ("let v = ring[turned / 45 deg]", "let v = ring[turned]"),
        ("let v = ring[2..6][turned]", "let v = ring[turned]"),
        ("let v = fresh(bumper)", "let v = fresh(turned)"),
    ],
)  # fmt: skip
def test_another_content(one: str, other: str) -> None:
    assert not is_same_content(one, other)


def test_memory_that_advances_in_other_frames_is_other_memory() -> None:
    """The module's memory stands still without `turned`, that of the file does not."""
    drive = "when {} and turned > 0 do drive(velocity = 1 mm/s) }} network {{ drive = m }}"
    one = "module m { " + drive.format("recently(bumper, 1 s)")
    other = "let near = recently(bumper, 1 s) module m { " + drive.format("near")
    a, b = load_text(RING + one), load_text(RING + other)
    of_a, of_b = contents(a, b)
    assert of_a.module(a.modules[0]) != of_b.module(b.modules[0])
    assert isinstance(difference(a, b, options=QUICK), Different)


# --- different -------------------------------------------------------------------------------------


def test_a_millimeter_is_found_in_one_frame() -> None:
    result = compare(ROAM, ROAM.replace("sonar < 1 m", "sonar < 1001 mm"))
    assert isinstance(result, Different)
    assert [dict(s.readings) for s in result.snapshots] == [{"sonar": 1000.0}]
    assert [run[-1].decisions[0].by for run in (result.a, result.b)] == ["cruise", "avoid"]


def test_a_tenth_of_a_second_of_memory_takes_two_frames() -> None:
    one = go("a", "recently(bumper, 1 s)") + "network { drive = a }"
    result = compare(one, one.replace("1 s", "1.1 s"))
    assert isinstance(result, Different)
    first, second = result.snapshots
    assert first.readings["bumper"] is True
    assert second.readings["bumper"] is False
    assert 1_000_000_000 <= second.t_ns - first.t_ns < 1_100_000_000


def test_a_time_constant_takes_two_frames() -> None:
    one = go("a", "level > 5") + CRUISE + "network { drive = a suppresses[1 s] cruise }"
    result = compare(one, one.replace("[1 s]", "[900 ms]"))
    assert isinstance(result, Different)
    assert len(result.snapshots) == 2
    assert verdict(one, one.replace("[1 s]", "")) == "Different"


def test_a_missing_sensor_can_be_all_the_difference() -> None:
    one = go("a", "level > 5 or sonar < 1 m") + "network { drive = a }"
    other = one.replace("sonar < 1 m", "value_or(sonar < 1 m, false)")
    result = compare(one, other)
    assert isinstance(result, Different)
    assert result.needed_missing == ("sonar",)


def test_a_param_that_nothing_depends_on_is_no_difference() -> None:
    one = "param spare = 1\n" + ROAM
    assert verdict(one, one.replace("spare = 1", "spare = 2")) == "Same"


def test_limits_and_idle_commands_count() -> None:
    limited = ROAM + "\nlimit drive.velocity <= 200 mm/s when level > 50"
    assert verdict(ROAM, limited) == "Different"
    assert verdict(limited, limited) == "Same"
    assert verdict(limited, limited.replace("> 50", "> 51")) == "Different"


def test_an_actuator_that_holds() -> None:
    one = ROAM + "\nmodule l { when level > 5 do lamp(on = true) }\nnetwork { lamp = l }"
    assert verdict(one, ROAM) == "Different"
    assert verdict(one, one.replace("on = true", "on = false")) == "Different"
    assert verdict(one, one.replace("level > 5", "not (level <= 5)")) == "Same"


# --- what is left out ------------------------------------------------------------------------------


def test_fields_actuators_and_modules_can_be_ignored() -> None:
    other = ROAM.replace("30 deg/s", "31 deg/s")
    assert verdict(ROAM, other) == "Different"
    assert verdict(ROAM, other, "drive.turn") == "Same"
    assert verdict(ROAM, other, "avoid") == "Same"
    assert verdict(ROAM, other, "cruise") == "Different"
    assert verdict(ROAM, other, "drive") == "Same"


def test_an_unknown_name_is_refused_with_those_that_there_are() -> None:
    [problem] = problems_of(compare, ROAM, ROAM, "drive.velocty")
    assert (problem.code, problem.hint) == ("V040", "did you mean `drive.velocity`?")
    hint = "known names: drive, lamp, drive.turn, drive.velocity, lamp.on, avoid, cruise"
    assert problems_of(compare, ROAM, ROAM, "xyz")[0].hint == hint


# --- robots that differ ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("range 0 .. 10000", "range 0 .. 5000", "sensor `sonar` has the range 0 mm .. 5000 mm, expected"),
        ("default 0", "default 1", "sensor `level` has the default 1.0, expected 0.0"),
        ("RServer.bumper", "RServer.front_bumper", "sensor `bumper` has the source `RServer.front_bumper`"),
        ("to DServer.Lamp", "to DServer.Other", "actuator `lamp` commands `DServer.Other`"),
        ("on : bool", "on : number", "actuator `lamp` has the fields `on : number`, expected `on : bool`"),
        (
            "sensor bumper ",
            "sensor touch ",
            "sensor `touch` reads `RServer.bumper`, expected the name `bumper`",
        ),
    ],
)
def test_robots_must_be_alike(old: str, new: str, message: str) -> None:
    other = load_text(ROBOT.replace(old, new) + ROAM)
    [problem] = problems_of(difference, program(ROAM), other, options=QUICK)
    assert problem.code == "V041"
    assert problem.message.startswith(message)


# --- modules in Python -----------------------------------------------------------------------------

PYTHON = """
module p from python "nowhere:Nothing" { param gain = 2 reads sonar, level commands drive }
network { drive = p suppresses cruise }
"""


def test_one_class_with_the_same_params_and_reads_gives_the_same_answers() -> None:
    one, other = CRUISE + PYTHON, CRUISE + PYTHON.replace("p ", "q ").replace("p suppresses", "q suppresses")
    result = compare(one, other.replace("q suppresses cruise", "q suppresses (q suppresses cruise)"))
    assert isinstance(result, Same)
    assert ("p", "q") in result.matching.same


@pytest.mark.parametrize(
    ("old", "new"), [("gain = 2", "gain = 3"), ("sonar, level", "sonar"), ("Nothing", "X")]
)
def test_another_class_may_answer_anything(old: str, new: str) -> None:
    result = compare(CRUISE + PYTHON, CRUISE + PYTHON.replace(old, new))
    assert isinstance(result, DifferenceUndecided)
    assert "modules in Python" in result.because[0]


# --- actuators of other names ----------------------------------------------------------------------


def test_the_two_networks_of_figure_4_14() -> None:
    figure = load_file(ROOT / "behaviors" / "figure_4_14.colony")
    assert isinstance(difference(figure, figure, actuators=[("left", "right")]), Same)
    text = (ROOT / "behaviors" / "figure_4_14.colony").read_text()
    other = load_text(text.replace("A2 suppresses (B2", "B2 suppresses (A2"))
    result = difference(figure, other, actuators=[("left", "right")])
    assert isinstance(result, Different)
    assert result.actuators == (("left", "right"),)
    assert len(result.snapshots) == 1


def test_figure_4_14_as_two_files(tmp_path: Path) -> None:
    text = (ROOT / "behaviors" / "figure_4_14.colony").read_text()
    robot = text[text.index("robot bench") : text.index("module A ")].replace(
        "  actuator right { priority : number range 0 .. 4 } to DServer.Right idle right(priority = 0)\n", ""
    )
    modules = "".join(
        f"module {name} {{ when {name.lower()} do left(priority = {4 - i}) }}\n"
        for i, name in enumerate("ABCD")
    )
    renamed = modules
    for name in "ABCD":
        renamed = renamed.replace(f"module {name} ", f"module {name}_prime ")
    (tmp_path / "bench.colony").write_text(robot)
    head = 'import "bench.colony"\n'
    left = tmp_path / "left.colony"
    left.write_text(f"{head}{modules}network {{ left = (A suppresses B) suppresses (C suppresses D) }}\n")
    right = tmp_path / "right.colony"
    wiring = "A_prime suppresses (B_prime suppresses (C_prime suppresses D_prime))"
    right.write_text(f"{head}{renamed}network {{ left = {wiring} }}\n")
    result = difference(load_file(left), load_file(right))
    assert isinstance(result, Same)
    assert ("A", "A_prime") in result.matching.same
    right.write_text(right.read_text().replace(wiring, "B_prime suppresses A_prime"))
    assert isinstance(difference(load_file(left), load_file(right)), Different)


# --- every behavior with one constant changed ------------------------------------------------------

MUTANTS = [
    ("wander", "param clearance = 1.1 m", "param clearance = 1.101 m"),
    ("wander", "recently(near, 400 ms)", "recently(near, 500 ms)"),
    ("teleop", "suppresses[2 s]", "suppresses[2.1 s]"),
    ("allen", "1 s^-1, 45 deg/s", "1 s^-1, 46 deg/s"),
    ("hallway", "param cruising = 500 mm/s", "param cruising = 501 mm/s"),
    ("herbert", "param turning  = 100", "param turning  = 101"),
    ("figure_4_14", "A { when a do left(priority = 4)", "A { when a do left(priority = 3.5)"),
]


@pytest.mark.parametrize("mutant", sampled(MUTANTS, every=6, thorough=True), ids=" ".join)
def test_a_behavior_with_one_constant_changed(mutant: tuple[str, str, str]) -> None:
    name, old, new = mutant
    path = ROOT / "behaviors" / f"{name}.colony"
    text = path.read_text()
    assert old in text
    robot = None if name == "figure_4_14" else "rome"
    changed = load_text(text.replace(old, new, 1), directory=path.parent, robot=robot)
    result = difference(load_file(path), changed, options=replace(QUICK, resources=5 * QUICK.resources))
    assert isinstance(result, Different)
    assert len(result.snapshots) <= 3
