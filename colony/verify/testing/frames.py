"""Random frames for a program: readings near its thresholds, and times near its durations."""

from __future__ import annotations

from colony.ir import expression as ir
from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, PythonModule, gaps_ns, is_regular
from colony.ir.types import Quantity
from colony.ir.walk import all_subexpressions
from colony.ir.wiring import wiring_graph
from colony.text.units import TIME
from colony.verify.testing.drawing import Choices
from colony.verify.testing.example_frames import frames_of
from colony.verify.testing.readings import Thresholds, draw_reading, thresholds_among


def draw_frame(choices: Choices, program: Program, t_ns: int) -> Frame:
    """Draw a frame; see `colony.verify.testing.strategies.frames`."""
    thresholds = thresholds_of(program)
    readings = {s.name: draw_reading(choices, s, thresholds) for s in program.robot.sensors}
    return Frame(t_ns, _some_sent(choices, program, readings))


def draw_trace(
    choices: Choices, program: Program, max_frames: int, *, mirrored: bool = False
) -> tuple[Frame, ...]:
    """Draw a trace; see `colony.verify.testing.strategies.traces`.

    With `mirrored`, arrays also recur in reverse, so that what is on one side is on the other a frame later.
    """
    thresholds = thresholds_of(program)
    # Few readings per sensor, used repeatedly, since memory has effects only if values recur. In a calm trace
    # most sensors do not change: conditions that need several readings at once hold only there. Sensors that
    # nothing reads matter only for the records about them.
    is_calm, read = choices.one_in(3), sensors_read(program)
    pools = {}
    for s in program.robot.sensors:
        is_constant = s.name not in read or (is_calm and not choices.one_in(4))
        count = 1 if is_constant else choices.mostly_large(1, 4)
        pools[s.name] = [draw_reading(choices, s, thresholds) for _ in range(count)]
        if mirrored and not is_constant:
            pools[s.name] += [x[::-1] for x in pools[s.name] if isinstance(x, list | tuple)]
    gaps = gaps_of(program)
    frames = [*_beginning_of_test(choices, program, max_frames)]
    t_ns = (
        frames[-1].t_ns + choices.pick(gaps) if frames else choices.pick((0, 1_000_000_000, 1, -50_000_001))
    )
    while not frames or (len(frames) < max_frames and choices.up_to(14) > 0):
        restarted = not frames and reads_restarted(program) and choices.one_in(2)
        readings = {name: choices.pick(pool) for name, pool in pools.items()}
        frames.append(Frame(t_ns, _some_sent(choices, program, readings), restarted=restarted))
        t_ns += choices.pick(gaps)
    return tuple(frames)


def _some_sent(choices: Choices, program: Program, readings: dict[str, Reading]) -> dict[str, Reading]:
    """Return the readings without most of those of what actuators were given last.

    Without a reading it is what the executor sent itself.
    """
    own = {s.name for s in program.robot.sensors if s.sent is not None and not choices.one_in(4)}
    return {name: reading for name, reading in readings.items() if name not in own} if own else readings


def _beginning_of_test(choices: Choices, program: Program, max_frames: int) -> tuple[Frame, ...]:
    """Return, occasionally, the beginning of a test of the program, which leads to interesting situations."""
    if not program.tests or not choices.one_in(3):
        return ()
    written = frames_of(program, choices.pick(program.tests))
    begun = written[: choices.up_to(min(len(written), max_frames - 1))]
    return begun if is_regular(program.robot, (frame.t_ns for frame in begun)) else ()


def thresholds_of(program: Program) -> Thresholds:
    """Return the constants in the program's expressions, by dimension."""
    return thresholds_among(all_subexpressions(program))


def sensors_read(program: Program) -> frozenset[str]:
    """Return the sensors that some expression or module in Python reads."""
    found: set[str] = set()
    for node in all_subexpressions(program):
        match node:
            case ir.SensorValue(name=name) | ir.Fresh(name=name, derived=False):
                found.add(name)
            case _:
                pass
    return frozenset(found)


def reads_restarted(program: Program) -> bool:
    """Return True if some expression reads `restarted`."""
    return any(isinstance(node, ir.Restarted) for node in all_subexpressions(program))


# --- times ---------------------------------------------------------------------------------------


def gaps_of(program: Program) -> list[int]:
    """Return times between frames: one to three periods, and the program's durations, exactly or 1 ns off."""
    frame = program.robot.frame_ns
    gaps = {frame: None, 2 * frame: None, 3 * frame: None, 1: None}
    for duration in (*durations_of(program), *_times_compared(program)):
        for gap in (duration, duration - 1, duration + 1, duration - frame):
            if gap > 0:
                gaps[gap] = None
    shortest, longest = gaps_ns(program.robot)
    ends = (shortest, longest) if longest is not None else ()
    return [gap for gap in (*gaps, *ends) if gap >= shortest and (longest is None or gap <= longest)]


def durations_of(program: Program) -> list[int]:
    """Return the durations that the program measures, in nanoseconds, each once."""
    found: dict[int, None] = {}
    for wiring_node in wiring_graph(program).nodes:
        found[wiring_node.window_ns] = None
    for node in all_subexpressions(program):
        if isinstance(node, ir.MemoryCall):
            found[node.duration_ns] = None
    for module in program.modules:
        if isinstance(module, PythonModule) and module.rate_ns is not None:
            found[module.rate_ns] = None
    found.pop(0, None)
    return list(found)


def _times_compared(program: Program) -> list[int]:
    """Return the first few times that `elapsed` and `now` may be compared with, in nanoseconds."""
    found: dict[int, None] = {}
    for node in all_subexpressions(program):
        match node:
            case ir.Constant(type=Quantity(dimension=dimension), value=float(seconds)):
                if dimension == TIME and 0 < seconds < _MAX_WAIT_S:
                    found[round(seconds * 1e9)] = None
            case _:
                pass
    return list(found)[:8]


_MAX_WAIT_S = 86_400.0
"""Maximum time, in seconds, that is taken as a waiting time."""
