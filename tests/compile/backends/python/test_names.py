"""Names in generated Python: never twice the same, and none that Python or the backend needs for itself."""

from __future__ import annotations

import pytest

from colony.compile.backends.python.text import UniqueNames
from tests.programs import lowered

TEXT = """
robot r {
  sensor max : number from DServer.x
  sensor has_b : bool from DServer.y
  sensor b : bool from DServer.b
  actuator out { v : number, bounds : number } to DServer.out idle hold
}
module m { when b do out(v = max, bounds = 0) }
network { out = m }
"""


def names(*taken: str) -> UniqueNames:
    return UniqueNames(lowered(TEXT), frozenset(taken))


@pytest.mark.parametrize(
    ("wanted", "given"),
    [
        ("speed", "speed"),
        ("Speed9", "Speed9"),
        ("brooks.avoid", "brooks_avoid"),
        ("m near [3] k=1", "m_near__3__k_1"),
        ("_x", "v_x"),
        ("__x", "v__x"),
        ("3a", "v3a"),
        ("é", "v_"),
        ("Abz9é", "vAbz9_"),
        ("", "v"),
        ("class", "class_2"),
        ("print", "print_2"),
        ("sqrt", "sqrt_2"),
        ("match", "match_2"),
        *((ours, f"{ours}_2") for ours in "self first_ns step t t_ns readings records".split()),
        *((ours, f"{ours}_2") for ours in "breaches reading settled fault".split()),
        ("helper", "helper_2"),
    ],
)
def test_what_is_wanted_and_what_is_given(wanted: str, given: str) -> None:
    assert names("helper").new(wanted) == given


def test_a_name_is_given_once() -> None:
    one = names()
    assert [one.new(wanted) for wanted in ("x", "x", "x", "x_3", "x")] == ["x", "x_2", "x_3", "x_3_2", "x_4"]
    assert [one.new("_y") for _ in range(2)] == ["v_y", "v_y_2"]


def test_the_names_of_a_program() -> None:
    one = names()
    assert one.sensors == {"max": "max_2", "has_b": "has_b", "b": "b"}
    assert one.fresh == {"max": "has_max", "has_b": "has_has_b", "b": "has_b_2"}
    assert one.decision == {"out": "out"}
    assert one.by == {"out": "out_by"}
    assert one.commanded == {"out": "out_commanded"}
    assert one.field == {("out", 0): "out_v", ("out", 1): "out_bounds"}
    assert one.bounds == {"out": "out_bounds_2"}
    assert [one.value(10**6), one.value(10**6)] == ["v1000000", "v1000000_2"]
