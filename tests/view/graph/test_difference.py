from __future__ import annotations

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.view.graph.difference import difference_lines, marks_of
from colony.view.graph.graph import to_dot, to_mermaid
from tests.networks import chain

_MODULES = ("cruise", "avoid", "back_off", "spin", "blind")


def program(network: str, *, failsafe: str = "", modules: tuple[str, ...] = _MODULES) -> Program:
    """Return a program of modules that drive, but for `blind`, with this network."""
    lines = [
        f"{'failsafe ' if name == failsafe else ''}module {name} {{ when bumper"
        f"{'' if name == 'blind' else ' do drive(v = 1)'} }}"
        for name in modules
        if name in network
    ]
    return load_text(
        "robot r { sensor bumper : bool from S.b  actuator drive { v : number } to R.d idle hold }\n"
        + "\n".join(lines)
        + f"\nnetwork {{ {network} }}\n"
    )


OLD = program("roam = back_off suppresses avoid suppresses cruise  drive = blind inhibits roam")


def test_a_module_that_is_inserted() -> None:
    new = program(
        "roam = back_off suppresses spin suppresses avoid suppresses cruise  drive = blind inhibits roam"
    )
    assert difference_lines(OLD, new) == [
        "modules:",
        "  + spin",
        "drive, by priority:",
        "  + spin: below back_off, above avoid",
        "wires:",
        "  - roam = back_off suppresses avoid suppresses cruise",
        "  + roam = back_off suppresses spin suppresses avoid suppresses cruise",
    ]
    text = to_mermaid(new, marks=marks_of(OLD, new))
    assert '("spin"):::added' in text
    assert text.count(":::added") == 2  # the module and its node
    assert ":::moved" not in text


def test_modules_that_are_lost_or_move() -> None:
    new = program("drive = avoid suppresses[1 s] (blind inhibits back_off)", failsafe="avoid")
    assert difference_lines(OLD, new) == [
        "modules:",
        "  - cruise",
        "    avoid: now failsafe",
        "drive, by priority:",
        "    avoid: highest, above back_off (was below back_off)",
        "  - cruise",
        "wires:",
        "  - roam = back_off suppresses avoid suppresses cruise",
        "  - drive = blind inhibits roam",
        "  + drive = avoid suppresses[1 s] blind inhibits back_off",
    ]
    marks = marks_of(OLD, new)
    assert marks.removed == ("cruise",)
    assert 'r0("cruise"):::removed' in to_mermaid(new, marks=marks)
    assert '[["avoid"]]:::moved' in to_mermaid(new, marks=marks)
    dot = to_dot(new, marks=marks)
    assert 'style="rounded,dashed"' in dot
    assert 'label="avoid"' in dot
    assert "penwidth=3" in dot


def test_nothing_changes_between_equal_networks() -> None:
    assert difference_lines(OLD, OLD) == []
    assert to_mermaid(OLD, marks=marks_of(OLD, OLD)) == to_mermaid(OLD)
    assert to_dot(OLD, marks=marks_of(OLD, OLD)) == to_dot(OLD)


def test_an_unnamed_dominant_wire_is_in_parentheses() -> None:
    new = program("drive = (blind inhibits back_off) suppresses avoid suppresses cruise")
    assert "  + drive = (blind inhibits back_off) suppresses avoid suppresses cruise" in difference_lines(
        OLD, new
    )


def test_deep_networks_do_not_recurse() -> None:
    deep = chain(3_000)
    assert difference_lines(deep, deep) == []
    assert len(to_mermaid(deep)) < 1_000_000
