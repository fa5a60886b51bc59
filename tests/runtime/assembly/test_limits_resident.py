"""The limits of a robot's description while no program runs: they hold whoever drives, in every frame."""

from __future__ import annotations

from contextlib import suppress

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.runtime.assembly.limits import (
    lead_limits,
    limit_bindings,
    limit_deployment,
    limit_nodes,
    limit_servers,
)
from colony.runtime.frames.clock import Clock
from colony.runtime.kit.description import Reading, field
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script as Generator
from colony.runtime.kit.script import do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import actuator, data
from colony.runtime.protocol.deployment import LIMITS_RUN, client_addresses
from colony.runtime.protocol.messages import Node, Sample, Verdict
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport
from tests.kit.lift import move_command, service
from tests.kit.node_stage import MS, S
from tests.runtime.assembly.resident_stage import Robot, description
from tests.runtime.scripted import Script

WANDER = """
language 1
import robot
module cruise {{ when true  do drive(velocity = {velocity} mm/s, turn = 0) }}
network {{ drive = cruise }}
{limit}
"""


def wall(t_ns: int) -> Sample:
    """Return sonars that see a wall ahead, 50 mm nearer every 100 ms, and stay 200 mm away from it."""
    ahead = max(200.0, 2000.0 - 50.0 * (t_ns // (100 * MS)))
    return Sample((5000.0,) * 12 + (ahead,) + (5000.0,) * 11, t_ns)


def robot(velocity: float = 600.0, **devices: object) -> tuple[Robot, Script]:
    script = Script(**devices)  # type: ignore[arg-type]
    return Robot(script.drivers, script.clock, velocity=velocity, limits=description()), script


def velocities(verdicts: list[Verdict]) -> list[float]:
    return [float(verdict.values[0]) for verdict in verdicts if verdict.values is not None]


def at(one: Robot, t_ns: int, action: object) -> None:
    one.transport.at(t_ns, lambda: action() and None)  # type: ignore[operator]


def test_whoever_drives_toward_a_wall_is_slowed_to_the_limit() -> None:
    one, script = robot(sonar_at=wall)
    one.run(6 * S)
    assert {tick.run for tick in one.ticks} == {LIMITS_RUN}
    sent = one.sent(S)
    assert len(sent) > 90
    for verdict in sent:
        ahead = wall(verdict.t_ns).value[12]  # type: ignore[index]
        assert velocities([verdict])[0] <= max(0.0, ahead - 150.0) + 1e-9, verdict
    assert velocities(sent)[-1] == 50.0, "200 mm from the wall, of which 150 are margin"
    assert velocities(sent)[0] == 600.0
    assert script.told[-1][1] == 50.0
    assert set(one.codes[5:]) == {None}


def test_nobody_drives_into_a_pressed_bumper() -> None:
    one, script = robot(bumper_at=lambda t_ns: t_ns >= 2 * S)
    one.run(4 * S)
    assert set(velocities(one.sent(2 * S + 50 * MS))) == {0.0}
    assert set(velocities(one.sent(S))[:15]) == {600.0}
    assert {velocity for t_ns, velocity, _ in script.told if t_ns > 2 * S + 50 * MS} == {0.0}


def test_where_the_sonar_is_missing_the_robot_stands_as_the_language_says() -> None:
    one, script = robot(sonar_at=lambda t_ns: None if t_ns >= 2 * S else Sample((5000.0,) * 24, t_ns))
    one.run(4 * S)
    assert {velocity for t_ns, velocity, _ in script.told if t_ns > 2 * S + 400 * MS} == {0.0}
    assert max(velocity for _, velocity, _ in script.told) == 600.0


@pytest.mark.parametrize("killed", ["limits", "Clock", "RServer"])
def test_what_dies_leaves_a_robot_that_stands_until_it_is_back(killed: str) -> None:
    one, script = robot(sonar_at=lambda t_ns: Sample((500.0,) * 24, t_ns))
    if killed == "limits":
        at(one, 2 * S, one.kill_limits)
        at(one, 4 * S, one.start_limits)
    else:
        at(one, 2 * S, lambda: one.kill(killed))
        at(one, 4 * S, lambda: one.start(killed))
    one.run(7 * S)
    assert {tick.run for tick in one.ticks} == {LIMITS_RUN}
    assert {velocity for _, velocity, _ in script.told} == {0.0, 350.0}
    assert {velocity for t_ns, velocity, _ in script.told if 2200 * MS < t_ns < 4 * S} <= {0.0}
    assert script.told[-1][1] == 350.0


def test_while_a_program_runs_its_limits_hold_and_then_those_of_the_description_again() -> None:
    one, script = robot(sonar_at=lambda t_ns: Sample((500.0,) * 24, t_ns))
    text = WANDER.format(velocity=80, limit="limit drive.velocity <= 100 mm/s")
    at(one, 2 * S, lambda: one.program(text, seconds=3.0))
    one.run(8 * S)
    runs = list(dict.fromkeys(tick.run for tick in one.ticks))
    assert runs == [LIMITS_RUN, "run 1"]
    begun = next(tick.t_ns for tick in one.ticks if tick.run == "run 1")
    ended = next(tick.t_ns for tick in one.ticks if tick.run == LIMITS_RUN and tick.t_ns > begun)
    assert set(velocities(one.sent(begun))) == {100.0, 350.0}
    for t_ns, velocity, _ in script.told:
        assert velocity in ((0.0, 100.0) if begun <= t_ns < ended else (0.0, 350.0)), t_ns
    assert {verdict.fates for verdict in one.verdicts if verdict.by == "cruise"} <= {(("cruise", "won"),)}
    assert script.told[-1][1] == 350.0


# --- what is deployed ------------------------------------------------------------------------------------


def test_the_limits_are_a_program_of_bounds_alone() -> None:
    deployed = limit_deployment(description())
    assert (deployed.run, deployed.resident) == (LIMITS_RUN, True)
    assert client_addresses(deployed) == (("drive/.bounds", "RServer"),)
    assert limit_servers(description()) == ("RServer",), "not DServer, whose actuators have none"


LIFTED = """
language 1
robot amr {
  sensor   height : mm   from Lift.height  within 300 ms
  sensor   level : number from Lift.height
  sensor   most : mm     from DServer.Most
  actuator lift { fast : bool, height : cm range 0 .. 40 }  to Lift.move  idle lift(fast = false, height = 0)
}
limit lift.height <= most
limit lift.height <= height + 10 cm
"""


def test_servers_of_users_are_assumed_to_be_as_the_description_says() -> None:
    compiled = compile_program(load_text(LIFTED)).compiled
    deployed = limit_deployment(compiled)
    assert deployed.servers == ("Lift",)
    assert limit_servers(compiled) == ("Lift", "DServer"), "as a limit reads a variable"


def test_a_lift_of_its_own_server_is_held_to_the_limits_of_the_description() -> None:
    compiled = compile_program(load_text(LIFTED)).compiled
    now, told, at_mm = VirtualClock(), list[tuple[int, float]](), [0.0]

    def move(height: float, fast: bool) -> None:
        told.append((now(), height))
        at_mm[0] = height

    def console() -> Generator:
        yield from sleep(0.5)
        while True:
            with suppress(RobotConnectionError):
                yield from do("Lift", actuator.command("move", {"height": 400.0, "fast": True}))
            yield from sleep(0.1)

    def operator() -> Generator:
        yield from sleep(2.0)
        yield from do("DServer", data.set("Most", 250.0))

    height = field("height", lambda: Reading(at_mm[0], age_ns=0), unit="mm", has_age=True)
    transport = VirtualTransport(now, seed=1)
    servers = ("Lift", "DServer")
    nodes: list[Node] = [
        Clock(servers=servers, resident=limit_deployment(compiled)),
        DServer(),
        service([height], [move_command(move)], print),
        *limit_nodes(compiled, limit_bindings(compiled.robot)),
        ScriptNode("limits", lead_limits(compiled), ("Clock", *servers)),
        ScriptNode("console", console(), ("Lift",), priority=5),
        ScriptNode("operator", operator(), ("DServer",)),
    ]
    for node in nodes:
        transport.add(node)
    transport.run_until(4 * S)
    assert {height for t_ns, height in told if t_ns < 2 * S} == {0.0}, "as nobody says what is the most"
    assert list(dict.fromkeys(height for _, height in told)) == [0.0, 100.0, 200.0, 250.0]


SIDEWAYS = """
language 1
robot slider {
  actuator drive { velocity : mm/s range -100 .. 100, turn : deg/s range -10 .. 10,
                   sideways : mm/s range -50 .. 50 }
           to RServer.drive  idle drive(velocity = 0, turn = 0, sideways = 0)
}
limit drive.sideways <= 20 mm/s
"""


def test_a_refusal_of_the_limits_is_reported_once() -> None:
    compiled = compile_program(load_text(SIDEWAYS)).compiled
    script, reports = Script(), list[str]()
    transport = VirtualTransport(script.clock, seed=1)
    leader = ScriptNode("limits", lead_limits(compiled, reports.append), ("Clock", "RServer"))
    clock = Clock(servers=("RServer",), resident=limit_deployment(compiled))
    for node in (clock, RServer(script.drivers.base), leader):
        transport.add(node)
    transport.run_until(2 * S)
    assert reports == [
        "the limits of slider do not hold at RServer: "
        "RServer.deploy: `drive`: it drives sideways, which this base cannot"
    ]
