"""A joystick at full speed toward walls: what the limits of the frame forbid is never sent.

`python -m tests.runs.test_joystick_limits 1000` draws as many situations.
"""

from __future__ import annotations

import sys
from functools import cache
from random import Random

import pytest

from colony.analysis.audit import audit
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.execute.compiled import Compiled
from colony.ir.frame import given_in_frame
from colony.ir.program import Program
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import robot
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World
from colony.verify.reference.interpreter import Interpreter
from tests.paths import BEHAVIORS
from tests.runtime.scripted import Log
from tests.sampling import sampled

MS = 1_000_000
SITUATIONS = 20
RUN_NS = 2_000 * MS


@cache
def wander() -> tuple[Program, Compiled]:
    """Return a program with the interface of rome.colony, whose limits brake it before walls."""
    (path,) = [path for path in BEHAVIORS if path.stem == "wander"]
    program = load_file(path)
    return program, compile_program(program).compiled


def room(random: Random) -> World:
    """Return the robot in a room, somewhere and facing anywhere, with a wall across a part of it."""
    width, length = random.uniform(1500, 6000), random.uniform(1500, 6000)
    at = random.uniform(-length / 2, -500)
    walls = [
        (-width / 2, -length / 2, width / 2, -length / 2),
        (-width / 2, length / 2, width / 2, length / 2),
        (-width / 2, -length / 2, -width / 2, length / 2),
        (width / 2, -length / 2, width / 2, length / 2),
        (-width / 2, at, random.uniform(-width / 2, width / 2), at),
    ]
    pose = (random.uniform(-200, 200), random.uniform(0, 200), random.uniform(0, 360))
    return World(walls=walls, poses=[pose], seed=random.randrange(1 << 30))


def joystick(random: Random) -> Script:
    """Drive at full speed, ahead or back, and turn as drawn; from time to time otherwise."""
    while True:
        velocity = random.choice((600.0, 600.0, -600.0, random.uniform(-600, 600)))
        turn = random.choice((0.0, random.uniform(-90, 90)))
        for _ in range(random.randrange(1, 5)):
            yield from do("RServer", robot.drive(velocity, turn, lease=0.5))
            yield from sleep(random.uniform(0.02, 0.3))


def driven(seed: int) -> list[RunFrame]:
    """Return the frames of a drawn situation; in one of four, the clients die in the middle of it."""
    random = Random(seed)
    _, compiled = wander()
    clock, log = VirtualClock(), Log()
    plant = Plant(room(random), clock)
    node = ScriptNode("joystick", joystick(random), ("RServer",), priority=1000, delay_ns=1)
    session = VirtualSession(
        compiled, simulated_drivers(plant), clock=clock, seed=seed, sinks=(log,), nodes=(node,)
    )
    if random.random() < 0.25:
        dies_ns = random.randrange(RUN_NS)
        session.transport.at(dies_ns, lambda: session.kill("clients"))
        session.transport.at(dies_ns + 300 * MS, lambda: session.restart("clients"))
    session.run(RUN_NS)
    assert node.problem is None
    return log.frames


def limits_are_obeyed(seed: int) -> int:
    """Check a situation frame by frame; return in how many frames the limits held the joystick back."""
    program, frames = wander()[0], driven(seed)
    (drive,) = (a for a in program.robot.actuators if a.name == "drive")
    interpreter, bounded, outside = Interpreter(program, answers_given=True), 0, 0
    for log in frames:
        if log.restart:
            interpreter = Interpreter(program, answers_given=True)
        interpreter.step(log.frame, given=given_in_frame(program.robot.actuators, log.verdicts))
        verdict = log.verdicts.get("drive")
        if verdict is None or verdict.outside is None:
            continue
        outside += 1
        if verdict.fault is not None:
            assert verdict.values == (0.0, 0.0)
            continue
        assert verdict.values is not None
        bounds = interpreter.bounds(drive)
        assert bounds is not None
        for value, bound in zip(verdict.values, bounds, strict=True):
            assert bound[0] <= value <= bound[1], f"seed {seed}, frame {log.tick.k}"
            bounded += value in bound
    assert outside, f"seed {seed}: nobody drove"
    assert audit(program, frames).agrees, f"seed {seed}"
    broken = {name for log in frames for name in log.breaches}
    assert not broken & {"brakes_in_time", "never_rams", "never_backs_into"}, f"seed {seed}: {broken}"
    return bounded


@pytest.mark.parametrize("seed", sampled(range(SITUATIONS), every=5))
def test_what_the_limits_forbid_is_never_sent(seed: int) -> None:
    limits_are_obeyed(seed)


def test_the_situations_are_such_that_limits_hold() -> None:
    assert any(limits_are_obeyed(seed) for seed in range(3))


@pytest.mark.thorough
def test_what_the_limits_forbid_is_never_sent_in_many_situations() -> None:
    assert sum(map(limits_are_obeyed, range(1000, 1120))) > 120


if __name__ == "__main__":
    count = int(sys.argv[1])
    print(f"{count} situations, held back in {sum(map(limits_are_obeyed, range(count)))} fields")
