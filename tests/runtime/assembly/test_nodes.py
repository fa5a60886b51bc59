"""Who takes part in a run is known without building anybody, and each can be built alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest

from colony.compile.pipeline import compile_program
from colony.execute.compiled import Compiled
from colony.ir.program import Actuator, ActuatorField, Module, PythonModule, TransferFunction, Use, Wire
from colony.ir.types import DIMENSIONLESS
from colony.runtime.assembly.nodes import build_announcer, build_clients, build_observer
from colony.runtime.assembly.sharing import ClientProcess, announcer_process_name, client_processes
from colony.runtime.protocol.bindings import bind
from colony.text.diagnostics import DiagnosticError
from tests.robot_servers import ROME_SERVERS
from tests.runtime.assembly.test_virtual import pulsing
from tests.runtime.programs import constant, drive, number, roam


def with_light(on_loss: Literal["stop", "degrade"]) -> Compiled:
    """A program with a second actuator, for which this is declared."""
    light = Actuator(
        name="light",
        fields=(ActuatorField(name="value", type=DIMENSIONLESS),),
        server="DServer",
        command="Light",
        idle=None,
        on_loss=on_loss,
    )
    program, lit = roam(), TransferFunction(actuator="light", fields=(number(1.0),))
    return compile_program(
        replace(
            program,
            robot=replace(program.robot, actuators=(drive(), light)),
            modules=(*program.modules, Module(name="shine", when=constant(True), command=lit)),
            wires=(*program.wires, Wire(name="light", actuator="light", wiring=Use(name="shine"))),
        )
    ).compiled


DRIVING = (("drive", "back_off"), ("drive", "avoid"), ("drive", "cruise"))
SHINE = ("light", "shine")


def test_all_clients_share_a_process_unless_they_are_to_be_lost_one_by_one() -> None:
    everyone, shining = (*DRIVING, SHINE), ClientProcess((SHINE,), shared=False)
    assert client_processes(with_light("stop"), isolate=False) == (ClientProcess(everyone, shared=True),)
    assert client_processes(with_light("degrade"), isolate=False) == (
        ClientProcess(DRIVING, shared=True),
        shining,
    )
    for program in (with_light("stop"), with_light("degrade")):
        apart = tuple(ClientProcess((client,), shared=False) for client in everyone)
        assert client_processes(program, isolate=True) == apart


def test_the_shared_process_is_called_the_same_however_many_clients_it_has() -> None:
    assert ClientProcess((*DRIVING, SHINE), shared=True).name == "clients"
    assert ClientProcess((SHINE,), shared=True).name == "clients"
    assert ClientProcess((SHINE,), shared=False).name == "light/shine"


@pytest.mark.parametrize("actuator", ["activity", "DServer", "clients"])
def test_no_two_processes_of_a_program_have_one_name(actuator: str) -> None:
    clients = ((actuator, "activity"), (actuator, "pulse"))
    names = [
        *(ClientProcess((client,), shared=False).name for client in clients),
        ClientProcess(clients, shared=True).name,
        *(announcer_process_name(module) for _, module in clients),
    ]
    assert len(set(names)) == len(names)


def test_clients_of_a_process_share_a_node_where_they_wait_for_the_same() -> None:
    compiled = with_light("stop")
    (process,) = client_processes(compiled, isolate=False)
    nodes = build_clients(compiled, bind(compiled.robot, ROME_SERVERS), process.clients, "run")
    assert [node.program.clients for node in nodes] == [
        ("drive/back_off",),
        ("drive/avoid", "drive/cruise"),
        ("light/shine",),
    ]
    assert {topic for topic in nodes[0].listens if topic.endswith("/frames")} == {
        "Clock/frames",
        "RServer/frames",
    }


def test_members_of_a_program() -> None:
    compiled = compile_program(roam()).compiled
    assert compiled.clients == (("drive", "back_off", 3), ("drive", "avoid", 2), ("drive", "cruise", 1))
    assert compiled.python_modules == ()
    assert compiled.clients_by_actuator == {"drive": ("back_off", "avoid", "cruise")}


def test_each_module_in_python_is_a_process_of_its_own_and_no_other_imports_it() -> None:
    program = pulsing()
    pulse = program.modules[0]
    assert isinstance(pulse, PythonModule)
    program = replace(program, modules=(replace(pulse, module_path="no.such.module"), program.modules[1]))
    compiled = compile_program(program).compiled
    assert compiled.python_modules == ("pulse",)
    assert compiled.clients_by_actuator == {"drive": ("pulse", "cruise")}
    bindings = bind(program.robot, ROME_SERVERS)
    for module in ("cruise", "pulse"):
        (node,) = build_clients(compiled, bindings, [("drive", module)], "run")
        assert node.address == f"drive/{module}"
    assert "DServer/activity/pulse/frames" in build_observer(compiled, bindings, (), "run").listens
    with pytest.raises(DiagnosticError, match="P001"):
        build_announcer(compiled, bindings, "pulse", "run")
    with pytest.raises(KeyError):
        build_announcer(compiled, bindings, "cruise", "run")
    with pytest.raises(KeyError):
        build_clients(compiled, bindings, [("drive", "cruise"), ("drive", "nobody")], "run")


def test_one_client_listens_to_no_more_than_it_reads() -> None:
    program = roam()
    compiled = compile_program(program).compiled
    bindings = bind(program.robot, ROME_SERVERS)
    (back_off,) = build_clients(compiled, bindings, [("drive", "back_off")], "run")
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
