"""Input and output of an executor for one frame. Every executor uses these types.

Values are in the units that the executed program declares: an executor multiplies by a sensor's factor on the
way in and divides by a field's factor on the way out. Views of one client or module, and the programs of the
fast loop (`robot_in_base_units`), declare base units, in which servers publish: their factors are 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple, Protocol

from colony.ir.program import Actuator, in_base_units
from colony.ir.types import ScalarValue

# --- frame ---------------------------------------------------------------------------------------------


Reading = ScalarValue | int | Sequence[ScalarValue | int] | None


_NO_TIMES: Mapping[str, int] = {}


class Frame(NamedTuple):
    """One consistent snapshot: the time and the readings of the sensors.

    A sensor that is absent, or None, is missing. Times are in nanoseconds and strictly increase. `taken_ns`
    has the times at which readings were taken, by the same clock; the default is the frame's time. A reading
    older than its sensor's `within` is missing, and one from the future is a sensor fault. `restarted` is
    True in the first frame after the runtime lost the program's memory.
    """

    t_ns: int
    readings: Mapping[str, Reading]
    taken_ns: Mapping[str, int] = _NO_TIMES
    restarted: bool = False


Bid = Literal[
    "command",  # active: the network lets its command through
    "suppressed",  # its predicate holds, but the network puts another module's command in its place
    "inhibited",  # its predicate holds, but another module inhibits it in the network
    "inactive",  # its predicate does not hold
    "silent",  # something that it reads is missing
]
"""A client's request in a frame, or the reason why it makes none, as the client itself decides it."""


class Answer(NamedTuple):
    """The answer of a module in Python in one frame.

    `values` are the fields of its command in base units, None if the module is not applicable. `error` is
    true if its `step` raised, or did not return a command or None. `blind` is true if there is no answer:
    something that the module reads is missing, or its last call failed, or has not answered yet.
    """

    values: tuple[ScalarValue, ...] | None = None
    error: bool = False
    blind: bool = False


class OverriddenCommand(NamedTuple):
    """What an actuator was given in a frame in which that is not what the network decided.

    `values` are the fields that somebody outside the network commanded, in base units as they read back from
    declared ones (`ir.frame.value_sent` undoes the rounding at the bounds); None if the actuator was idle:
    its client was late, its server was down, or it was stopped. Memory and network go on as without it. The
    decision is by no module: `by M` is false of every M. With values, the fields are these, and the actuator
    is commanded; with None, it gets its idle command (on `idle hold` it holds what it was given last), and is
    idle.
    """

    values: tuple[ScalarValue, ...] | None = None


NOTHING_GIVEN: Mapping[str, OverriddenCommand] = {}
"""No exception: each actuator got what the network decided."""


RecordKind = Literal[
    "sensor fault",  # wrong type or length, not a number, or no such enumerator: the sensor is missing
    "sensor clamped",  # outside its range
    "python error",  # a Python module raised, or returned neither a command nor None: it is not active
    "missing",  # the winner is failsafe and blind: the actuator gets its idle command
    "not finite",  # the winner's command: the actuator gets its idle command
    "bound missing",  # of a limit, on `idle hold`: nothing is sent
    "limits contradict",  # a lower bound of a field is above an upper one: the actuator gets its idle command
    "limited",  # a field was bounded by a limit
    "command clamped",  # a field was outside the actuator's range
]


class FrameEvent(NamedTuple):
    """A noteworthy event; `subject` is a sensor, a module, or `actuator.field`."""

    kind: RecordKind
    subject: str


class Decision(NamedTuple):
    """The winner of an actuator in a frame, and the command that is sent.

    `by` is the winning module or None; `values` are the fields in the program's units, None when nothing
    is sent (`idle hold`); `fault` is "missing", "not finite", "bound missing" or "limits contradict" when
    the winner's command could not be sent.
    """

    actuator: str
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fault: str | None = None


class Outcome(NamedTuple):
    """The result of a frame: a decision per actuator (in the order declared), records, broken contracts.

    Records are ordered: sensors as declared; Python modules as declared; then for each actuator as declared,
    the winner's fault or, field by field, limited before clamped.
    """

    decisions: tuple[Decision, ...]
    records: tuple[FrameEvent, ...] = ()
    breaches: tuple[str, ...] = ()

    @property
    def commands(self) -> dict[str, Decision]:
        """The decisions, by actuator."""
        return {decision.actuator: decision for decision in self.decisions}


class Executor(Protocol):
    """Executes a program, frame after frame, and holds its memory."""

    def step(self, frame: Frame) -> Outcome:
        """Execute one frame."""
        ...


# --- given ---------------------------------------------------------------------------------------------
#
# What an actuator was given in a frame, read from the outcome that was published or recorded.


class ActuatorOutcome(Protocol):
    """The outcome of one actuator in one frame; `runtime.messages.Verdict` defines each attribute."""

    @property
    def by(self) -> str | None:
        """The module that won, if any."""
        ...

    @property
    def values(self) -> tuple[ScalarValue, ...] | None:
        """The command that was sent, in declared units, None if nothing was."""
        ...

    @property
    def fault(self) -> str | None:
        """The reason why the idle command was sent instead, if any."""
        ...

    @property
    def fates(self) -> Sequence[tuple[str, str]]:
        """Each client and its fate, then those of connections from outside that commanded in vain."""
        ...

    @property
    def outside(self) -> str | None:
        """The client outside the network that acted, if any."""
        ...

    @property
    def hold(self) -> str | None:
        """The reason why the network did not decide, if any."""
        ...

    @property
    def violation(self) -> bool:
        """True if two clients commanded in one frame."""
        ...

    @property
    def unlimited(self) -> bool:
        """True if the limits did not hold for the client outside the network."""
        ...


MISSED = frozenset({"late", "lost", "refused"})
"""Fates of clients whose requests did not count, so that the actuator may have been idle."""


def is_connection(party: str) -> bool:
    """Return True if a party that has a fate is a connection from outside (`user/id`), not a client."""
    return "/" in party


def given_in_frame(
    actuators: Iterable[Actuator], outcomes: Mapping[str, ActuatorOutcome]
) -> dict[str, OverriddenCommand]:
    """Return what actuators were given where that may not be what the network decided.

    That is the command of a connection from outside; or nothing, if the actuator was idle because the command
    of that connection could not be sent, because of a stop or a lock, or because a client was not heard.
    """
    return {
        actuator.name: OverriddenCommand(_values_outside(actuator, outcome))
        for actuator in actuators
        if (outcome := outcomes.get(actuator.name)) is not None and not _is_the_networks(outcome)
    }


def value_sent(value: ScalarValue, factor: float, low: float | None, high: float | None) -> ScalarValue:
    """Return what was sent to a field, in base units, given what it reads back as.

    Outcomes are in declared units, and the conversion there and back rounds: 30 deg/s reads back as
    29.999999999999996 deg/s from a field in rad/s. A value that is beyond a bound of its frame, but is what
    that bound reads back as, was the bound.
    """
    if low is not None and value < low and low / factor * factor == value:
        return low
    if high is not None and value > high and high / factor * factor == value:
        return high
    return value


def _is_the_networks(outcome: ActuatorOutcome) -> bool:
    if outcome.by is not None:
        return True
    undisturbed = outcome.outside is None and outcome.hold is None
    return undisturbed and not any(fate in MISSED for _, fate in outcome.fates)


def _values_outside(actuator: Actuator, outcome: ActuatorOutcome) -> tuple[ScalarValue, ...] | None:
    if outcome.outside is None or outcome.fault is not None or outcome.values is None:
        return None
    return in_base_units(outcome.values, actuator.fields)
