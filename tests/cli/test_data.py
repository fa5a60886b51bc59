"""`colony data`, with a DServer in a process of its own."""

from __future__ import annotations

import json

from colony.runtime.library import data
from tests.cli.conftest import Colony
from tests.cli.machine import ROBOT, Machine, failed
from tests.waiting import until


def test_variables_are_set_shown_listed_and_deleted(machine: Machine, colony: Colony) -> None:
    served = machine.start("serve", "DServer", "--robot", ROBOT)
    until(lambda: failed(served) or "DServer" in machine.directory.running(), "DServer runs")
    for name, value in (
        ("Goal.x", "-90.5"),
        ("Goal.y", "[1, true]"),
        ("Door", '"103"'),
        ("Map", '{"a": null}'),
    ):
        assert colony("data", "set", name, value) == (0, "", "")
        assert json.loads(colony.output("data", "get", name, "--robot", ROBOT)) == json.loads(value)
    assert colony("data", "list") == (0, "Door\nGoal.x\nGoal.y\nMap\n", "")
    assert colony("data", "list", "Goal.") == (0, "Goal.x\nGoal.y\n", "")
    assert json.loads(colony("data", "list", "--format", "json").out) == ["Door", "Goal.x", "Goal.y", "Map"]
    assert colony("data", "delete", "Door", "Goal.x") == (0, "", "")
    missing = colony("data", "delete", "Door", "Map", "Goal.x")
    assert (missing.code, missing.out, missing.err.count("\n")) == (1, "", 2)
    assert "DServer has no variable `Door`" in missing.err
    assert colony("data", "list") == (0, "Goal.y\n", "")
    assert colony.refusal("data", "get", "Door", code=1) == "colony: error: DServer has no variable `Door`\n"
    with machine.session() as session, session.connect("DServer") as server:
        server.do(data.set("Bytes", b"\x00\xff"))
        for begin in range(0, 2500, 500):  # more names than one reply has
            server.do(data.set_many({f"V{i:04}": i for i in range(begin, begin + 500)}))
    assert colony("data", "get", "Bytes") == (0, '"AP8="\n', "")
    assert colony("data", "list", "V").out.split() == [f"V{i:04}" for i in range(2500)]
    assert served.interrupt() == 0


def test_misuse_is_one_line(machine: Machine, colony: Colony) -> None:
    for arguments, said in (
        (("list",), "no robot with a DServer runs on this machine"),
        (("get", "X", "--robot", ROBOT), ROBOT),
        (("set", "X", "text"), "VALUE is not valid JSON"),
        (("set", "X", "1" + "0" * 30 + ".0.0"), "VALUE is not valid JSON"),
        (("delete",), "Missing argument"),
        (("list", "--connect", "tls/rome.lab:7447"), "requires --robot"),
        (("list", "--connect", "tls/rome.lab:7447", "--robot", ROBOT), "requires --security"),
    ):
        done = colony("data", *arguments)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), arguments
        assert said in done.err


def test_names_that_are_no_text_are_refused_and_those_that_terminals_act_on_are_escaped() -> None:
    from colony.cli.reporting import printable

    assert printable("Pose\x1b[2J\nx") == "Pose\\x1b[2J\\nx"
    assert printable("Ort è 3 mm") == "Ort è 3 mm"
