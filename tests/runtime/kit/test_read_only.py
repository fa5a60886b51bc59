"""A server that commands nothing publishes its fields, and what another controller commands."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import BOOL, DIMENSIONLESS
from colony.ir.types import ScalarValue as Scalar
from colony.runtime.kit.description import describe
from colony.runtime.kit.devices import DeviceReader
from colony.runtime.kit.read_only import listening_server
from colony.runtime.library.actuator import arbitration
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.deployment import READ_ONLY
from colony.runtime.protocol.messages import Sample, ServerFrame, Tick
from colony.runtime.servers.drivers import OverheardCommand, Reading
from tests.kit.clock import deployed
from tests.kit.node_stage import MS, NodeStage, sent

SPEC = ServerSpec(
    "Panel",
    (FieldSpec("level", DIMENSIONLESS, ""),),
    (
        CommandSpec(
            "lamp", (ParameterSpec("level", DIMENSIONLESS, "", factor=10.0), ParameterSpec("on", BOOL, ""))
        ),
        CommandSpec("horn", (ParameterSpec("on", BOOL, ""),)),
    ),
)


class Panel:
    """A device. Mutable: what it hears, and what it was commanded."""

    def __init__(self) -> None:
        self.heard: dict[str, OverheardCommand | None] = {}
        self.commands: list[str] = []

    def fields(self) -> Mapping[str, Reading | None]:
        return {"level": Reading(3.0, 0)}

    def overheard(self) -> Mapping[str, OverheardCommand | None]:
        return self.heard

    def command(self, name: str, values: Mapping[str, Scalar]) -> None:
        self.commands.append(name)

    def safe(self) -> None:
        self.commands.append("safe")

    def close(self) -> None:
        self.commands.append("close")


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        (None, {}),
        ({"level": 2.0, "on": 1.0}, {"heard.lamp": Sample((20.0, True), 93 * MS)}),
        ({"on": False}, {"heard.lamp": Sample((0.0, False), 93 * MS)}),
    ],
)
def test_it_publishes_the_commands_in_force_and_commands_nothing(
    heard: Mapping[str, Scalar] | None, expected: Mapping[str, Sample]
) -> None:
    panel = Panel()
    panel.heard = {"lamp": None if heard is None else OverheardCommand(heard, 7 * MS), "horn": None}
    server = listening_server(SPEC, DeviceReader(SPEC, panel, print), panel, print)
    assert list(server.start(0)) == []
    found = sent(server, Tick(k=1, t_ns=100 * MS), now_ns=100 * MS)
    (fields,) = [message.fields for message in found if isinstance(message, ServerFrame)]
    assert fields == {"level": Sample(3.0, 100 * MS), **expected}
    server.close()
    assert panel.commands == []


def test_it_describes_what_it_hears_and_takes_no_command() -> None:
    panel = Panel()
    server = listening_server(SPEC, DeviceReader(SPEC, panel, print), panel, print)
    caller = NodeStage(server).connect()
    described = caller.do(describe())
    assert [field.name for field in described.fields] == ["level", "heard.lamp", "heard.horn"]
    assert described.commands == ()
    assert caller.refusal(arbitration()) == "method"
    assert caller.problem(deploy(deployed())).message == READ_ONLY
