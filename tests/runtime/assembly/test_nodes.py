"""Who takes part in a run is known without building anybody, and each can be built alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.pipeline import compile_program
from colony.ir.program import PythonModule
from colony.runtime.assembly.nodes import build_announcer, build_client, build_observer
from colony.runtime.protocol.bindings import bind
from colony.text.diagnostics import Failure
from tests.runtime.assembly.test_virtual import pulsing
from tests.runtime.programs import roam


def test_members_of_a_program() -> None:
    compiled = compile_program(roam()).compiled
    assert compiled.clients == (("drive", "back_off", 3), ("drive", "avoid", 2), ("drive", "cruise", 1))
    assert compiled.announced == ()
    assert compiled.places == {"drive": ("back_off", "avoid", "cruise")}


def test_each_module_in_python_is_a_process_of_its_own_and_no_other_imports_it() -> None:
    program = pulsing()
    pulse = program.modules[0]
    assert isinstance(pulse, PythonModule)
    program = replace(program, modules=(replace(pulse, module_path="no.such.module"), program.modules[1]))
    compiled = compile_program(program).compiled
    assert compiled.announced == ("pulse",)
    assert compiled.places == {"drive": ("pulse", "cruise")}
    bindings = bind(program.robot)
    assert build_client(compiled, bindings, "drive", "cruise", "run").address == "drive/cruise"
    assert build_client(compiled, bindings, "drive", "pulse", "run").address == "drive/pulse"
    assert "DServer/activity/pulse/frames" in build_observer(compiled, bindings, (), "run").listens
    with pytest.raises(Failure, match="P001"):
        build_announcer(compiled, bindings, "pulse", "run")
    with pytest.raises(KeyError):
        build_announcer(compiled, bindings, "cruise", "run")
    with pytest.raises(KeyError):
        build_client(compiled, bindings, "drive", "nobody", "run")


def test_one_client_listens_to_no_more_than_it_reads() -> None:
    program = roam()
    compiled = compile_program(program).compiled
    bindings = bind(program.robot)
    back_off = build_client(compiled, bindings, "drive", "back_off", "run")
    assert back_off.listens == (
        "Clock/ticks",
        "Clock/frames",
        "RServer/frames",
        "DServer/recalled/drive/back_off",
    )
    observer = build_observer(compiled, bindings, (), "run")
    assert "RServer/requests" not in observer.listens
    heeding = build_observer(compiled, bindings, (), "run", requests=True)
    assert set(heeding.listens) - set(observer.listens) == {"RServer/requests"}
