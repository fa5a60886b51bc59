"""Random walks through a system, to refute guesses without asking the solver about each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from random import Random

import z3

from colony.ir.program import Robot, gaps_ns
from colony.verify.contracts.candidates import Candidate
from colony.verify.contracts.cone import facts, within
from colony.verify.contracts.solver import Answer, Budget, Solver
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Number, SensorInput

_WALKS = 5
_STEPS = 8
_PRESENT_PROBABILITY = 0.85
_UNBOUNDED_WIDTH = 1000
"""Width of the range from which readings are drawn if the sensor's range is unbounded."""


def not_refuted(cone: Cone, guesses: Sequence[Candidate], budget: Budget) -> list[Candidate]:
    """Return the guesses that hold before every frame of the walks. Deterministic."""
    remaining = list(guesses)
    for walk in range(_WALKS):
        for model in _walk(cone, Random(walk), budget):
            remaining = [
                g for g in remaining if not z3.is_false(model.eval(g.formula, model_completion=True))
            ]
    return remaining


def _walk(cone: Cone, random: Random, budget: Budget) -> Iterator[z3.ModelRef]:
    """Yield a model for each frame of a run with random readings, until the solver finds none quickly."""
    solver = Solver(budget, share=0.1)
    solver.add(facts(cone))
    memory = [cell.initial for cell in cone.cells]
    t_ns = 0
    for _ in range(_STEPS):
        solver.push()
        solver.add(*(c.old == value for c, value in zip(cone.cells, memory, strict=True)))
        solver.add(cone.system.now == t_ns, *_readings(cone, random))
        answer = solver.check()
        if answer is Answer.SAT:
            model = solver.model()
            memory = [model.eval(cell.next, model_completion=True) for cell in cone.cells]
            yield model
        solver.pop()
        if answer is not Answer.SAT:
            return
        t_ns += _gap(random, cone.system.program.robot)


def _gap(random: Random, robot: Robot) -> int:
    """Draw the time to the next frame, in nanoseconds."""
    shortest, longest = gaps_ns(robot)
    periods = random.choice((1, 1, 1, 4, 40, 400))
    return periods * robot.frame_ns if longest is None else random.choice((shortest, robot.frame_ns, longest))


def _readings(cone: Cone, random: Random) -> Iterator[z3.BoolRef]:
    """Yield the readings of a cone's sensors: mostly present, anywhere in their ranges."""
    for sensor_input in cone.system.sensors.values():
        if within(cone, sensor_input.present):
            yield sensor_input.present == z3.BoolVal(random.random() < _PRESENT_PROBABILITY)
        yield from _elements(cone, sensor_input, random)


def _elements(cone: Cone, sensor_input: SensorInput, random: Random) -> Iterator[z3.BoolRef]:
    """Yield values of a sensor; elements of an array are close together or spread out."""
    base, spread = random.random(), random.choice((0.0, 0.1, 1.0))
    for element in sensor_input.elements:
        if not isinstance(element, Number):
            if within(cone, element):
                yield element == z3.BoolVal(random.random() < 0.5)
        elif within(cone, element.value) and z3.is_const(element.value) and not element.cases:
            low, high = element.bounds.low, element.bounds.high
            low = Fraction(-_UNBOUNDED_WIDTH) if low is None else low
            high = low + _UNBOUNDED_WIDTH if high is None else high
            fraction = Fraction(
                min(1.0, max(0.0, base + spread * (random.random() - 0.5)))
            ).limit_denominator(64)
            value = low + fraction * (high - low)
            yield element.value == z3.Q(value.numerator, value.denominator)
