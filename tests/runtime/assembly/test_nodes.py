"""Who takes part in a run is known without building anybody, and each can be built alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.pipeline import compile_program
from colony.ir.program import PythonModule
from colony.runtime.assembly.nodes import (
    Members,
    build_announcer,
    build_client,
    build_observer,
    members,
    places_of,
)
from colony.runtime.protocol.bindings import bind
from colony.text.diagnostics import Failure
from tests.runtime.assembly.test_virtual import pulsing
from tests.runtime.programs import roam


def test_members_of_a_program() -> None:
    program = roam()
    clients = compile_program(program).clients
    assert members(program, clients) == Members(
        clients=(("drive", "back_off"), ("drive", "avoid"), ("drive", "cruise")), announced=()
    )
    assert places_of(program, clients) == {"drive": ("back_off", "avoid", "cruise")}


def test_modules_in_python_are_announced_where_another_guard_needs_them_and_not_imported() -> None:
    program = pulsing()
    pulse = program.modules[0]
    assert isinstance(pulse, PythonModule)
    program = replace(program, modules=(replace(pulse, module_path="no.such.module"), program.modules[1]))
    clients = compile_program(program).clients
    who = members(program, clients)
    assert who.announced == ("pulse",)
    assert who.addresses == ("drive/pulse", "drive/cruise", "DServer/activity/pulse")
    bindings = bind(program)
    assert build_client(program, clients, bindings, "drive", "cruise", "run").address == "drive/cruise"
    with pytest.raises(Failure, match="P001"):
        build_client(program, clients, bindings, "drive", "pulse", "run")
    with pytest.raises(Failure, match="P001"):
        build_announcer(program, bindings, "pulse", "run")
    with pytest.raises(KeyError):
        build_announcer(program, bindings, "cruise", "run")
    with pytest.raises(KeyError):
        build_client(program, clients, bindings, "drive", "nobody", "run")


def test_one_client_listens_to_no_more_than_it_reads() -> None:
    program = roam()
    clients = compile_program(program).clients
    bindings = bind(program)
    back_off = build_client(program, clients, bindings, "drive", "back_off", "run")
    assert back_off.listens == (
        "Clock/ticks",
        "Clock/frames",
        "RServer/frames",
        "DServer/recalled/drive/back_off",
    )
    observer = build_observer(program, bindings, (), "run")
    assert "RServer/requests" not in observer.listens
    heeding = build_observer(program, bindings, (), "run", requests=True)
    assert set(heeding.listens) - set(observer.listens) == {"RServer/requests"}
