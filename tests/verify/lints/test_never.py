"""Lints that say "never" and "always": what each finds, and what is near to it and must not be found."""

from __future__ import annotations

import pytest

from tests.verify.lints.programs import codes, found
from tests.verify.small_robot import go

BLIND = "module blind { when not (fresh(sonar) and fresh(bumper)) }\n"
SAFE = "network { drive = blind inhibits (%s) }\n"


def test_a_shadowed_module_is_told_with_who_dominates_it() -> None:
    text = go("a", "sonar < 1 m") + go("b", "sonar < 500 mm") + BLIND + SAFE % "a suppresses b"
    expected = "`b` can never get through: wherever it is active, `a` dominates it"
    assert found(text) == [("V020", expected)]


def test_of_those_that_dominate_a_module_only_a_least_set_is_named() -> None:
    modules = go("near", "sonar < 1 m") + go("other", "bumper") + go("far", "sonar >= 1 m")
    text = modules + go("final", "sonar > 100 mm and bumper or sonar <= 2 m") + BLIND
    text = text.replace("when bumper ", "when level > 200 or level > 60 ")
    [(code, message)] = found(text + SAFE % "near suppresses other suppresses far suppresses final")
    assert code == "V020"
    assert message.endswith("wherever it is active, `near` or `far` dominates it")


def test_a_module_that_a_dominant_one_leaves_a_corner_is_not_shadowed() -> None:
    text = go("a", "sonar < 500 mm") + go("b", "sonar <= 500 mm") + BLIND + SAFE % "a suppresses b"
    assert codes(text) == []


def test_a_module_that_only_inhibits_gets_through_where_it_inhibits() -> None:
    text = "module docked { when level > 50 }\n" + go("a", "true")
    assert codes(text + "network { drive = docked inhibits a }") == []


def test_one_that_another_always_inhibits_for_is_shadowed() -> None:
    text = "module low { when level < 50 }\nmodule empty { when level < 10 }\n" + go("a", "true")
    [(code, message)] = found(text + "network { drive = (low suppresses empty) inhibits a }")
    assert (code, message) == (
        "V020",
        "`empty` can never get through: wherever it is active, `low` dominates it",
    )


def test_a_module_used_twice_gets_through_if_it_does_in_one_place() -> None:
    text = go("a", "level > 50") + go("b", "level > 60") + "module i { when level > 90 }\n"
    assert "V020" in codes(text + "network { drive = a suppresses b }")
    assert "V020" not in codes(text + "network { drive = b suppresses (i inhibits (a suppresses b)) }")


def test_memory_may_keep_a_module_from_being_shadowed() -> None:
    short = go("a", "recently(level > 50, 1 s)") + go("b", "recently(level > 50, 2 s)")
    assert codes(short + "network { drive = a suppresses b }") == []
    long = go("a", "recently(level > 50, 2 s)") + go("b", "level > 50")
    assert codes(long + "network { drive = a suppresses b }") == ["V020"]


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("level > 100", ["V021"]),
        ("level >= 100", []),
        ("level >= 0", ["V022"]),
        ("level > 0", []),
        ("level < 20 and level > 30", ["V021"]),
        ("latch(level > 100, false)", ["V021"]),
        ("latch(level > 99, false)", []),
        ("previous(level, -1) >= 0", []),
        ("previous(level, 1) >= 0", ["V022"]),
        ("true", []),
        ("1 > 2", []),
    ],
)
def test_predicates_that_never_or_always_hold(when: str, expected: list[str]) -> None:
    assert codes(go("a", when) + "network { drive = a }") == expected


def test_what_is_said_of_predicates() -> None:
    assert found(go("a", "sonar > 11 m") + "network { drive = a }") == [
        ("V021", "`a` is never active: its predicate `sonar > 11 m` is false whatever the sensors read")
    ]
    [(_, message)] = found(go("a", "sonar <= 10 m") + "network { drive = a }")
    assert message.startswith("`a` is always active while `sonar` is present: its predicate `sonar <= 10 m`")


def test_an_inhibitor_that_never_meets_what_it_inhibits() -> None:
    text = "module docked { when level > 50 }\n" + go("a", "level <= 50")
    assert found(text + "network { drive = docked inhibits a }") == [
        ("V023", "`docked inhibits a` changes nothing: where `docked` would inhibit, `a` is not active")
    ]
    assert codes(text.replace("<= 50", "<= 51") + "network { drive = docked inhibits a }") == []


def test_merging_behaviors_that_exclude_each_other_is_good_use_of_a_suppressor() -> None:
    text = go("a", "level > 50") + go("b", "level <= 50")
    assert codes(text + "network { drive = a suppresses b }") == []


def test_a_time_constant_for_what_never_ends_or_never_follows() -> None:
    text = go("a", "latch(level > 50, false)") + go("b", "true")
    [(code, message)] = found(text + "network { drive = a suppresses[1 s] b }")
    assert code == "V024"
    assert message.startswith("the time constant of `a suppresses[1 s] b` changes nothing: within 1 s after")
    reset = go("a", "latch(level > 50, level < 10)") + go("b", "true")
    assert codes(reset + "network { drive = a suppresses[1 s] b }") == []


@pytest.mark.parametrize(
    ("contract", "expected"),
    [
        ("level > 100 implies drive.velocity == 0", ["V027"]),
        ("level > 99 implies drive.velocity == 0 or true", []),
        ("not (level > 100)", []),
        ("lamp.on or level >= 0", []),
        ("sonar > 10 m implies drive.velocity == 0", ["V027"]),
        ("value_or(lamp.on, false) or level >= 0", []),
        ("level > 100 implies lamp.on", ["V027"]),
    ],
)
def test_contracts_that_promise_nothing(contract: str, expected: list[str]) -> None:
    from tests.verify.lints.programs import ROBOT

    lamp = ROBOT.rstrip().removesuffix("}") + "actuator lamp { on : bool } to DServer.L idle hold }\n"
    text = go("a", "true") + f"network {{ drive = a }}\ncontract k: {contract}\n"
    assert [code for code, _ in found(text, lamp)] == expected


def test_modules_that_always_act_together() -> None:
    text = go("a", "bumper") + go("b", "bumper", "-100 mm/s") + "module i { when level > 5 }\n"
    assert found(text + "network { drive = (i inhibits a) suppresses b }") == [
        ("V029", "`a` and `b` are always active together, and both command `drive`")
    ]
    assert codes(text + "network { drive = a suppresses b }") == ["V020"]
    apart = text.replace("b { when bumper", "b { when bumper and sonar > 0")
    assert codes(apart + "network { drive = (i inhibits a) suppresses b }") == []
