"""Deployment of a program: what servers must know of it, such as clients, priorities and the frame period.

A deployment is sent in a call, so that the program itself may run anywhere. The leader of a run deploys the
program to the Clock and to every server with a bound actuator, and again to any of them that restarts. While
the leader is connected, no other process may deploy.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal

import msgspec

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS
from colony.ir.program import Actuator, Robot, Role, role_name, sent_name
from colony.ir.servers import DSERVER
from colony.ir.types import Bool, Enum, ScalarValue
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import ActuatorBinding, Bindings
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.codec import FRAME_NUMBER_NS
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.interface import MAX_DIGESTS, Interface, interface_of

# --- deployment ----------------------------------------------------------------------------------------


MIN_FRAME_NS = FRAME_NUMBER_NS
MAX_FRAME_NS = 3_600_000_000_000
"""Limits of a robot's frame period, in nanoseconds.

Faster frames would run out of numbers (see `clock.py`); with slower ones a lost client would go unnoticed for
hours.
"""

MAX_DEPLOYMENT_BYTES = 256 * 1024
"""Byte limit of a deployment, in msgpack, that the method `deploy` of a server decodes."""


MAX_CLIENTS = 2000
"""Maximum number of clients of all actuators of a program: each frame carries the fate of every client."""

MAX_ITEMS = 1000
"""Maximum number of actuators in a deployment; also of fields of an actuator, Python modules, and so on."""

MAX_REPORTED = 5
"""Maximum number of names or priorities listed in a message."""

MAX_NAME_LENGTH = 255
"""Maximum number of characters of any name in a deployment."""

LIMITS_RUN = "limits"
"""Name of the run of a description's limits; the names of programs' runs begin with their dates."""


READ_ONLY = "the robot is served with --read-only, as another controller commands it"
"""The reason why a program is refused."""


class ActuatorFieldSpec(msgspec.Struct, frozen=True, kw_only=True):
    """A field of an actuator; `low` and `high` are in base units, `members` are the numbers of an enum."""

    name: str
    kind: Literal["bool", "number"]
    factor: float
    low: float | None
    high: float | None
    members: tuple[float, ...] = ()


class ActuatorSpec(msgspec.Struct, frozen=True, kw_only=True, rename={"field_indices": "places"}):
    """An actuator as its server arbitrates it.

    `field_indices[i]` is the index of the field for parameter i of the server's `command`, None if that
    parameter is always 0; `field_indices` is empty if the server takes the fields as they are. `idle` is in
    base units, None for `idle hold`. `clients` are names and priorities, highest first. `reported` is
    what the server publishes of the frame before: what a field, by its index, was given, or the role of a
    module. An actuator that is `limited` has one more client, `BOUNDS`, for the `Bounds` of each frame.
    """

    name: str
    fields: tuple[ActuatorFieldSpec, ...]
    server: str
    command: str
    field_indices: tuple[int | None, ...]
    idle: tuple[ScalarValue, ...] | None
    on_loss: Literal["stop", "degrade"]
    clients: tuple[tuple[str, int], ...]
    reported: tuple[int | Role, ...] = ()
    limited: bool = False


class Tunable(msgspec.Struct, frozen=True, kw_only=True):
    """A param that users change during a run.

    `initial` is its value at the start, `low` and `high` are its interval, all in `unit`, the declared unit.
    """

    name: str
    unit: str
    initial: float
    low: float
    high: float


class Deployment(msgspec.Struct, frozen=True, kw_only=True, rename={"python_modules": "announced"}):
    """A program on a robot. `run` is unique to the run; "" stands for a robot without a program.

    `seed` is the seed of `Runtime.random`. `python_modules` are the modules in Python, whose answers DServer
    relays. `servers` are read in addition to the servers that every robot has. With `lockstep`, each frame
    begins as soon as the previous one is decided, instead of after `frame_ns`. `reads` are the variables that
    the program's sensors are bound to: DServer's frames show them. `interface` is the one against which
    the program was checked. A `resident` deployment yields to every other one: it has the limits of the
    robot, which hold while no program runs. `tunables` are the params that may change in the run.
    """

    run: str
    program: str
    frame_ns: int
    seed: int
    actuators: tuple[ActuatorSpec, ...]
    python_modules: tuple[str, ...] = ()
    lockstep: bool = False
    servers: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    interface: Interface = Interface()
    resident: bool = False
    tunables: tuple[Tunable, ...] = ()


def deployment(
    compiled: Compiled,
    bindings: Bindings,
    *,
    run: str,
    seed: int,
    lockstep: bool = False,
    servers: tuple[str, ...] = (),
    resident: bool = False,
) -> Deployment:
    """Return the deployment of a compiled program."""
    limited = frozenset(limited_actuators(compiled))
    return Deployment(
        run=run,
        program=compiled.name,
        frame_ns=compiled.frame_ns,
        seed=seed,
        actuators=tuple(
            actuator_spec(
                wired.actuator,
                binding,
                tuple((c.module, c.priority) for c in wired.clients),
                reported=compiled.robot.read_before(wired.actuator.name),
                limited=wired.actuator.name in limited,
            )
            for wired, binding in zip(compiled.code.actuators, bindings.actuators, strict=True)
        ),
        python_modules=compiled.python_modules,
        lockstep=lockstep,
        servers=servers,
        reads=variables_read(bindings),
        interface=interface_of(compiled.robot),
        resident=resident,
        tunables=tunables_of(compiled.robot),
    )


def tunables_of(robot: Robot) -> tuple[Tunable, ...]:
    """Return the tunable params of a program."""
    return tuple(
        Tunable(
            name=s.name,
            unit=s.unit,
            initial=float(s.default or 0.0) / s.factor,
            low=-math.inf if s.low is None else _inside(s.low, s.factor, math.inf),
            high=math.inf if s.high is None else _inside(s.high, s.factor, -math.inf),
        )
        for s in robot.sensors
        if s.tunable
    )


def _inside(bound: float, factor: float, inward: float) -> float:
    """Return a bound in a declared unit, as it was written if that lies within it in base units."""

    def is_inside(x: float) -> bool:
        return x * factor >= bound if inward > 0 else x * factor <= bound

    written, exact = float(f"{bound / factor:.15g}"), bound / factor
    if is_inside(written):
        return written
    while not is_inside(exact):
        exact = math.nextafter(exact, inward)
    return exact


def tuned_with(
    tunables: Iterable[Tunable], tuned: Mapping[str, float], values: Mapping[str, float | None]
) -> dict[str, float]:
    """Return the values of tunable params after a change; None stands for the value at the start of the run.

    Raises:
        RefusedError: "arguments" if a name is not one of `tunables`, or a value is outside of its interval.
    """
    by_name, changed = {t.name: t for t in tunables}, dict(tuned)
    for name, value in values.items():
        tunable = by_name.get(name)
        if tunable is None:
            known = f"its tunable params are {', '.join(by_name)}" if by_name else "it has none"
            raise RefusedError("arguments", f"the program has no tunable param `{name}`; {known}")
        if value is None:
            changed.pop(name, None)
        elif tunable.low <= value <= tunable.high:
            changed[name] = value
        else:
            expected = f"{tunable.low:.9g} .. {tunable.high:.9g} {tunable.unit}".rstrip()
            raise RefusedError("arguments", f"`{name}` cannot be {value:.9g}: expected {expected}")
    return changed


def limited_actuators(compiled: Compiled) -> tuple[str, ...]:
    """Return the actuators with limits, to which the commands of connections are held."""
    return tuple(a.actuator.name for a in compiled.code.actuators if a.limits)


def variables_read(bindings: Bindings) -> tuple[str, ...]:
    """Return the variables of DServer that sensors are bound to, each once, in the order declared."""
    return tuple(dict.fromkeys(b.field for b in bindings.sensors if b.server == DSERVER.name and not b.sent))


def actuators_of(deployed: Deployment, server: str) -> tuple[ActuatorSpec, ...]:
    """Return the actuators that are bound to a server."""
    return tuple(spec for spec in deployed.actuators if spec.server == server)


def reported_name(spec: ActuatorSpec, of: int | Role) -> str:
    """Return the name under which the server of an actuator publishes one of its `reported`."""
    return role_name(spec.name, of) if isinstance(of, Role) else sent_name(spec.name, spec.fields[of].name)


def reported_fields(spec: ActuatorSpec) -> dict[str, ActuatorFieldSpec | None]:
    """Return the fields of `reported`, None for the role of a module, by `reported_name`."""
    return {reported_name(spec, i): None if isinstance(i, Role) else spec.fields[i] for i in spec.reported}


def client_addresses(deployed: Deployment) -> tuple[tuple[str, str], ...]:
    """Return every client's address, and the server that receives its requests or bounds."""
    return tuple(
        (topics.client_address(spec.name, client), spec.server)
        for spec in deployed.actuators
        for client in (*(name for name, _ in spec.clients), *((BOUNDS,) if spec.limited else ()))
    )


def problems(deployed: Deployment) -> tuple[str, ...]:
    """Return the reasons why a deployment is invalid; empty if it is valid.

    Reasons are a missing name, a frame period out of range, two clients with the same name or priority, and
    exceeded limits. Limits are checked first, so that nothing large is examined.
    """
    return tuple(_too_many(deployed)) or tuple(_problems(deployed))


def _too_many(deployed: Deployment) -> Iterator[str]:
    specs = deployed.actuators
    counts = [
        ("clients", sum(len(spec.clients) + spec.limited for spec in specs), MAX_CLIENTS),
        ("actuators", len(specs), MAX_ITEMS),
        ("fields of an actuator", max((len(spec.fields) for spec in specs), default=0), MAX_ITEMS),
        ("reported fields", max((len(spec.reported) for spec in specs), default=0), MAX_ITEMS),
        ("modules in Python", len(deployed.python_modules), MAX_ITEMS),
        ("servers", len(deployed.servers), MAX_ITEMS),
        ("variables", len(deployed.reads), MAX_ITEMS),
        ("tunable params", len(deployed.tunables), MAX_ITEMS),
        ("digests of the interface", deployed.interface.size, MAX_DIGESTS),
    ]
    for what, count, limit in counts:
        if count > limit:
            yield f"{count} {what}; expected at most {limit}"
    for name in (
        deployed.run,
        deployed.program,
        *deployed.python_modules,
        *deployed.servers,
        *deployed.reads,
        *(tunable.name for tunable in deployed.tunables),
    ):
        if len(name) > MAX_NAME_LENGTH:
            yield f"the name `{name[:20]}...` has {len(name)} characters; expected at most {MAX_NAME_LENGTH}"


def _problems(deployed: Deployment) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    if not MIN_FRAME_NS <= deployed.frame_ns <= MAX_FRAME_NS:
        expected = f"expected {MIN_FRAME_NS} to {MAX_FRAME_NS}"
        yield f"a frame of {deployed.frame_ns} ns; {expected}"
    for spec in deployed.actuators:
        yield from _problems_of(spec)


def _problems_of(spec: ActuatorSpec) -> Iterator[str]:
    for what, index in (("name", 0), ("priority", 1)):
        counts = Counter(client[index] for client in spec.clients)
        for duplicate in sorted(str(x) for x, count in counts.items() if count > 1)[:MAX_REPORTED]:
            yield f"{spec.name}: two clients have the {what} {duplicate}"
    if any(len(name) > MAX_NAME_LENGTH for name, _ in spec.clients):
        yield f"{spec.name}: the name of a client has more than {MAX_NAME_LENGTH} characters"
    if any(isinstance(i, Role) and len(i.module) > MAX_NAME_LENGTH for i in spec.reported):
        yield f"{spec.name}: the name of a reported module has more than {MAX_NAME_LENGTH} characters"
    if not all(isinstance(i, Role) or 0 <= i < len(spec.fields) for i in spec.reported):
        yield f"{spec.name}: a reported field that is none of its {len(spec.fields)} fields"
    if spec.idle is not None and len(spec.idle) != len(spec.fields):
        yield f"{spec.name}: an idle command of {len(spec.idle)} values, not {len(spec.fields)}"


def actuator_spec(
    actuator: Actuator,
    binding: ActuatorBinding,
    clients: tuple[tuple[str, int], ...],
    *,
    reported: tuple[int | Role, ...] = (),
    limited: bool = False,
) -> ActuatorSpec:
    """Return the actuator as the server that it is bound to must know it."""
    return ActuatorSpec(
        name=actuator.name,
        fields=tuple(
            ActuatorFieldSpec(
                name=f.name,
                kind="bool" if isinstance(f.type, Bool) else "number",
                factor=f.factor,
                low=f.low,
                high=f.high,
                members=tuple(number for _, number in f.type.members) if isinstance(f.type, Enum) else (),
            )
            for f in actuator.fields
        ),
        server=binding.server,
        command=binding.command,
        field_indices=binding.field_indices,
        idle=actuator.idle,
        on_loss=actuator.on_loss,
        clients=clients,
        reported=reported,
        limited=limited,
    )


# --- leadership ----------------------------------------------------------------------------------------
#
# Leadership of a run at a server: no other run is deployed while its leader is connected.
#
# A resident run yields: it is deployed while no other leader is connected, until another one deploys.


class Leadership:
    """The run deployed to a server, and its leader. Mutable."""

    def __init__(self, server: str) -> None:
        self._server = server
        self._run: str | None = None
        self._resident = False
        self._leader: Caller | None = None

    @property
    def leader(self) -> Caller | None:
        """The leader of the deployed run, None if it is not connected."""
        return self._leader

    @property
    def is_orphaned(self) -> bool:
        """True if the leader of the deployed run is lost; False if no leader has deployed one."""
        return self._run is not None and self._leader is None

    def take(self, caller: Caller, deployed: Deployment) -> bool:
        """Make a caller the leader; return True if its run is new, False if it is deployed already.

        Raises:
            RefusedError: "busy" while the leader of another run is connected; "arguments" for an invalid
                deployment.
        """
        leader = None if self._resident and not deployed.resident else self._leader
        if leader is not None and deployed.run != self._run and leader.connection != caller.connection:
            text = f"{self._server} is in the run `{self._run}`, which {leader.name} leads"
            raise RefusedError("busy", text)
        wrong = problems(deployed)
        if wrong:
            raise RefusedError("arguments", f"{self._server}.deploy: {'; '.join(wrong)}")
        self._leader = caller
        new = deployed.run != self._run
        self._run, self._resident = deployed.run, deployed.resident
        return new

    def on_lost(self, caller: Caller) -> bool:
        """Handle the end of a connection; return True if it was the leader's.

        Its deployment remains until another leader deploys.
        """
        is_lost = self._leader is not None and self._leader.connection == caller.connection
        if is_lost:
            self._leader = None
        return is_lost
