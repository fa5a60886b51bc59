"""The typed program: the meaning of a `.colony` file with its imports, for all later stages.

Names are final and unique: an entity of a file imported `as brooks` is called `brooks.name`, a let or
state of a module `module.name`. Durations are whole nanoseconds; constants are in base units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import field, replace
from itertools import pairwise
from reprlib import repr as short
from typing import Literal, Protocol

from colony.ir.expression import Expression
from colony.ir.site import Site
from colony.ir.types import BOOL, Enum, Scalar, ScalarValue, Type
from colony.record import Record, record
from colony.text.source import NOWHERE, Source, Span


@record
class Declared(Record):
    """A declaration: a unique name, and its span in the source text."""

    name: str
    span: Span = field(default=NOWHERE, compare=False, repr=False)


# --- robot ---------------------------------------------------------------------------------------


@record
class Role(Record):
    """What `module` did in a frame: `by`, its command was the actuator's; `active`, it was active."""

    kind: Literal["by", "active"]
    module: str


@record
class Before(Record):
    """What a sensor `last...` reads of `actuator`: the field with an index, or the role of a module."""

    actuator: str
    of: int | Role


@record
class Sensor(Declared):
    """A value that a server publishes each frame, or that is missing.

    `unit` is the declared unit, if any, and `factor` its size in base units: a reading is multiplied by it.
    `low` and `high` (inclusive; readings are clamped to them) and `default`, which fills an array, are in
    base units. `sent` is not None for `last...` (`sent_sensor`, `role_sensor`). A `tunable` one is a param
    that users change during a run, between `low` and `high`; each tick has its value. An `own` one is an
    input that the program declares.
    """

    type: Type
    unit: str = ""
    factor: float = 1.0
    low: float | None = None
    high: float | None = None
    default: ScalarValue | None = None
    server: str
    field: str
    within_ns: int | None = None
    sent: Before | None = None
    tunable: bool = False
    own: bool = False

    @property
    def of_robot(self) -> bool:
        """True for a sensor of the robot's interface, False for one that the program adds to it."""
        return self.sent is None and not self.tunable and not self.own


@record
class ActuatorField(Declared):
    """One field of an actuator's command; it is sent in `unit`, divided by `factor`.

    `low`, `high` and `default`, for commands that leave the field out, are in base units.
    """

    type: Scalar
    unit: str = ""
    factor: float = 1.0
    low: float | None = None
    high: float | None = None
    default: ScalarValue | None = None


@record
class Actuator(Declared):
    """A command interface of a robot. `idle` is the idle command in base units, or None for `idle hold`."""

    fields: tuple[ActuatorField, ...]
    server: str
    command: str
    idle: tuple[ScalarValue, ...] | None
    on_loss: Literal["stop", "degrade"] = "stop"


TUNABLE_SERVER = "Clock"
"""The node whose ticks have the values of tunable params."""

SENT = "last"
"""First part of the name of what an actuator was given in the frame before."""


def sent_name(actuator: str, field: str) -> str:
    """Return the name of what a field of an actuator was given in the frame before."""
    return f"{SENT}.{actuator}.{field}"


def sent_sensor(actuator: Actuator, index: int) -> Sensor:
    """Return `last.ACTUATOR.FIELD`: what a field of the actuator was given in the frame before.

    It is a sensor of the program that its server publishes, or that an executor alone knows from its own last
    frame, in the declared unit. Where nothing was sent, the idle command's value stands in as its default; on
    `idle hold` it is the last value sent, and missing before the first.
    """
    field = actuator.fields[index]
    idle = None if actuator.idle is None else actuator.idle[index]
    if idle is not None and not isinstance(idle, bool) and field.factor != 1.0:
        idle = idle / field.factor * field.factor  # as it is read back
    name = sent_name(actuator.name, field.name)
    return Sensor(
        name=name,
        span=field.span,
        type=field.type,
        unit=field.unit,
        factor=field.factor,
        low=field.low,
        high=field.high,
        default=idle,
        server=actuator.server,
        field=name,
        sent=Before(actuator=actuator.name, of=index),
    )


def role_name(actuator: str, role: Role) -> str:
    """Return the name of what a module of an actuator did in the frame before."""
    return f"{SENT}.{actuator} by {role.module}" if role.kind == "by" else f"{SENT}.{role.module} is active"


def role_sensor(actuator: Actuator, role: Role) -> Sensor:
    """Return `last.ACTUATOR by MODULE` or `last.MODULE is active`, which is false where it is not known."""
    name = role_name(actuator.name, role)
    return Sensor(
        name=name,
        type=BOOL,
        default=False,
        server=actuator.server,
        field=name,
        sent=Before(actuator=actuator.name, of=role),
    )


def value_before(
    of: int | Role, values: tuple[ScalarValue, ...] | None, by: str | None, is_active: Callable[[str], bool]
) -> ScalarValue | None:
    """Return what a sensor `last...` reads after a frame in which an actuator was given `values`.

    Args:
        of: a field, or the role of a module.
        values: the command; None if nothing was sent, and a field reads what it did before: None.
        by: the module whose command it was, if any.
        is_active: returns True if a module, a client of the actuator, was active.
    """
    match of:
        case Role(kind="by", module=module):
            return by == module
        case Role(module=module):
            return is_active(module)
        case index:
            return None if values is None else values[index]


class HasFactor(Protocol):
    """A field of a command; `factor` is its declared unit in base units."""

    @property
    def factor(self) -> float:
        """The factor from the declared unit to the base unit."""
        ...


def in_declared_units(
    values: tuple[ScalarValue, ...] | None, fields: Iterable[HasFactor]
) -> tuple[ScalarValue, ...] | None:
    """Return a command in the declared units of its fields, None for None; a bool has no unit."""
    if values is None:
        return None
    return tuple(
        [
            x if isinstance(x, bool) or field.factor == 1.0 else x / field.factor
            for x, field in zip(values, fields, strict=True)
        ]
    )


def in_base_units(values: tuple[ScalarValue, ...], fields: Iterable[HasFactor]) -> tuple[ScalarValue, ...]:
    """Return a command, given in the declared units of its fields, in base units."""
    pairs = zip(values, fields, strict=True)
    return tuple([x if isinstance(x, bool) else x * field.factor for x, field in pairs])


DEFAULT_FRAME_NS = 50_000_000


@record
class Robot(Declared):
    """A robot: sensors and actuators in the order declared, and the frame period.

    `jitter_ns` is how much longer or shorter than the period the time between frames may be; None for any.
    """

    frame_ns: int = DEFAULT_FRAME_NS
    jitter_ns: int | None = None
    sensors: tuple[Sensor, ...] = ()
    actuators: tuple[Actuator, ...] = ()

    def read_before(self, actuator: str) -> tuple[int | Role, ...]:
        """Return what the program reads of an actuator as `last...`."""
        sensors = (s.sent for s in self.sensors if s.sent is not None)
        return tuple(sent.of for sent in sensors if sent.actuator == actuator)


def gaps_ns(robot: Robot) -> tuple[int, int | None]:
    """Return the shortest and the longest time between two frames, in nanoseconds; None for any."""
    if robot.jitter_ns is None:
        return 1, None
    return robot.frame_ns - robot.jitter_ns, robot.frame_ns + robot.jitter_ns


def is_regular(robot: Robot, times_ns: Iterable[int]) -> bool:
    """Return True if the frames of a run come as closely at the robot's period as it says."""
    shortest, longest = gaps_ns(robot)
    gaps = (later - earlier for earlier, later in pairwise(times_ns))
    return all(shortest <= gap and (longest is None or gap <= longest) for gap in gaps)


REGULAR = "frames.regular"
"""Name of the contract about the times of frames, which no file can declare."""


def assumptions(program: Program) -> tuple[Contract, ...]:
    """Return what the files of a program assume of the world, as contracts that runs watch."""
    return tuple(c for c in program.contracts if c.is_assumption)


def without_assumed(program: Program) -> Program:
    """Return the program without the contracts that are assumed of the world."""
    required = tuple(c for c in program.contracts if not c.assumed)
    return program if len(required) == len(program.contracts) else replace(program, contracts=required)


def robot_in_base_units(robot: Robot) -> Robot:
    """Return the same robot with every sensor and every field of a command declared in base units."""
    return replace(
        robot,
        sensors=sensors_in_base_units(robot.sensors),
        actuators=tuple(
            replace(actuator, fields=tuple(replace(field, factor=1.0) for field in actuator.fields))
            for actuator in robot.actuators
        ),
    )


def sensors_in_base_units(sensors: Iterable[Sensor]) -> tuple[Sensor, ...]:
    """Return the same sensors, each declared in base units, in which the runtime has their readings."""
    return tuple(replace(sensor, factor=1.0) for sensor in sensors)


# --- derived values ------------------------------------------------------------------------------


@record
class Let(Declared):
    """A value computed once a frame. At file level it is missing if something that it reads is missing."""

    expression: Expression


@record
class State(Declared):
    """Memory: `next`, computed from old values, is its value in the next frame (None: it never changes).

    At file level it is unchanged by a frame in which something that `next` reads is missing.
    """

    type: Scalar
    initial: ScalarValue
    next: Expression | None


@record
class Transition(Record):
    """A transition, taken when the machine is in one of `sources` and `condition` is true.

    A `failsafe` one is taken also where its condition reads something missing.
    """

    sources: frozenset[float]
    target: float
    condition: Expression
    failsafe: bool = False
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@record
class Machine(Declared):
    """A state with named phases.

    The first transition of the present phase that applies takes effect in the next frame. One whose condition
    reads a missing value leaves its memory unchanged; it applies if it is failsafe, and otherwise keeps those
    below it from applying, failsafe ones excepted. The memory of all others advances in any phase. That of a
    sequence has `tasks`, the phases of its tasks in order.
    """

    type: Enum
    start: float
    transitions: tuple[Transition, ...]
    tasks: tuple[str, ...] = ()


Derived = Let | State | Machine

# --- modules -------------------------------------------------------------------------------------


@record
class TransferFunction(Record):
    """A transfer function: one expression for each field of `actuator`, in the order of its fields."""

    actuator: str
    fields: tuple[Expression, ...]


@record
class Module(Declared):
    """M(P, phi): `when` is the applicability predicate P, `command` the transfer function phi (thesis 4.8.2).

    It is silent (not active, memory unchanged) in a frame in which anything that `when`, `command`, `lets` or
    `states` read is missing. A `failsafe` one is then blind: active, with the actuator's idle command.
    """

    failsafe: bool = False
    params: tuple[tuple[str, ScalarValue], ...] = ()
    lets: tuple[Let, ...] = ()
    states: tuple[State, ...] = ()
    when: Expression
    command: TransferFunction | None = None

    @property
    def actuator(self) -> str | None:
        """Return the name of the actuator that the module commands, if any."""
        return self.command.actuator if self.command else None


@record
class PythonReading(Record):
    """An input of a Python module: a value that `step` gets each frame under `name`.

    `name` is as written in the behavior's file; `expression` is a sensor, a file-level let, a state or a
    machine.
    """

    name: str
    expression: Expression


@record
class PythonModule(Declared):
    """A module whose `step(frame)` is a method of the class `class_name` of the Python module `module_path`.

    The class is built with the params. A `failsafe` module is blind (see `Module`) where something that it
    reads is missing, and where it has no answer: before the first one, and after a call that failed.
    """

    failsafe: bool = False
    module_path: str
    class_name: str
    params: tuple[tuple[str, ScalarValue], ...] = ()
    reads: tuple[PythonReading, ...] = ()
    actuator: str | None = None
    rate_ns: int | None = None


AnyModule = Module | PythonModule

# --- network -------------------------------------------------------------------------------------


@record
class Use(Record):
    """A module or a wire, by name."""

    name: str
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@record
class Chain(Record):
    """`a op[w0] (b op[w1] (c ...))`: right-associative wiring of two or more operands by one relation.

    `windows_ns[i]` is the time constant between operand i and what follows it, 0 for none. A long
    chain is one flat object; only parentheses nest, up to `NESTING_LIMIT`.
    """

    relation: Literal["suppresses", "inhibits"]
    operands: tuple[Wiring, ...]
    windows_ns: tuple[int, ...]
    span: Span = field(default=NOWHERE, compare=False, repr=False)


Wiring = Use | Chain


@record
class Wire(Declared):
    """A named wire or, if `actuator` is set, that actuator's wiring (`name` is then not a wire's name)."""

    wiring: Wiring
    actuator: str | None = None


# --- limits, contracts, tests --------------------------------------------------------------------


@record
class Limit(Record):
    """A limit: a field of modules' commands to `actuator` is at most (`<=`) or at least (`>=`) `bound`.

    It applies if `condition` is true or absent, or if anything that the limit reads is missing. A bound that
    reads something missing, or is not finite, stands at the idle command's value; on `idle hold` nothing is
    sent. Condition and bound have separate memory.
    """

    actuator: str
    field_index: int
    relation: Literal["<=", ">="]
    bound: Expression
    condition: Expression | None = None
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@record
class Contract(Declared):
    """A contract: it must be true in every frame in which nothing that it reads is missing.

    One that is `assumed` is about the world: proofs take it for granted, and it is watched in runs alone.
    `assuming` names the assumptions that stand before `expression`: where one was broken, it is true.
    One `in_time` is about frames in which no client is late or lost (see `ir.walk`). The contract of a
    `reach` is that no run gets to where it leads, with every client in time: it is to be refuted.
    `requirements` are the ids of those that it belongs to.
    """

    expression: Expression
    assumed: bool = False
    in_time: bool = False
    reach: bool = False
    assuming: tuple[str, ...] = ()
    requirements: tuple[str, ...] = field(default=(), compare=False)

    @property
    def is_assumption(self) -> bool:
        """True for one that a file declares by `assume`."""
        return self.assumed and self.name != REGULAR


@record
class GivenReading(Record):
    """A sensor's value in a test, from this step on, in base units; None for missing.

    `index` selects one element; without it a scalar fills an array. With `age_ns`, the reading was taken that
    long before the first frame of the step, and ages; without, it stays as fresh as it is.
    """

    sensor: str
    index: int | None
    value: ScalarValue | tuple[ScalarValue, ...] | None
    age_ns: int | None = None
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@record
class ExampleStep(Record):
    """A step of a test: frames at `times_ns` (one for `at`, several for `from`), with `expectations`.

    `restarted` is the value of `restarted` in its first frame; it is true at most in the first step.
    """

    times_ns: tuple[int, ...]
    given: tuple[GivenReading, ...]
    expectations: tuple[Expression, ...]
    restarted: bool = False
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@record
class Example(Declared):
    """A `test` block: `name` is its title."""

    steps: tuple[ExampleStep, ...]


@record
class Program(Record):
    """A typed program.

    `derived` and `wires` are sorted topologically: each comes after those that it is computed from.
    `modules`, `limits`, `contracts` and `reaches` are in the order written. `files` are the source texts,
    imported files first, each with the relative path (with `/`) by which other files import it; none if the
    program was built in memory. `site` has the params that a site set, if it set any; they are part of all
    else already.
    """

    robot: Robot
    derived: tuple[Derived, ...] = ()
    modules: tuple[AnyModule, ...] = ()
    wires: tuple[Wire, ...] = ()
    limits: tuple[Limit, ...] = ()
    contracts: tuple[Contract, ...] = ()
    reaches: tuple[Contract, ...] = ()
    tests: tuple[Example, ...] = ()
    files: tuple[tuple[str, Source], ...] = field(default=(), compare=False, repr=False)
    site: Site | None = field(default=None, compare=False, repr=False)


def modules_that_can_be_lost(program: Program) -> tuple[str, ...]:
    """Return the modules whose clients can be lost one by one: of `on_loss degrade`, failsafe ones aside.

    Where the client of a failsafe module is lost, its actuator is idle.
    """
    degrading = {a.name for a in program.robot.actuators if a.on_loss == "degrade"}
    return tuple(m.name for m in program.modules if m.actuator in degrading and not m.failsafe)


def expect_program(given: object) -> None:
    """Check that an argument of a library function is a program.

    Raises:
        TypeError: it is not.
    """
    if not isinstance(given, Program):
        raise TypeError(f"found {short(given)}; expected a program, as `colony.load` returns it")
