"""The compiled form: prioritized clients, one per module and actuator (thesis section 4.8.2).

An actuator's winner is the first client whose guard holds and, equivalently, the only one whose exclusive
guard holds: in no frame do two exclusive guards of one actuator hold.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from colony.compile.guards import Guard


@dataclass(frozen=True, slots=True, kw_only=True)
class Client:
    """A module as a client of its actuator's server.

    `guard` and `exclusive` are indices into the guards of the client list; both include the module's own
    activity. `guard` is the thesis's, to be combined with priorities. `exclusive` holds only in frames in
    which the network lets the module through. With several paths to the actuator, both are the exclusive
    guard.
    """

    module: str
    priority: int
    guard: int
    exclusive: int
    has_several_paths: bool = field(default=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorClients:
    """The clients of one actuator, highest priority first; priorities are n, ..., 2, 1."""

    actuator: str
    clients: tuple[Client, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientList:
    """All clients of a program over one table of guards.

    Attributes:
        guards: the table of guards.
        actuators: the clients of each wired actuator.
        observed: the guard for the activity of each wire or module that contracts and tests read.
        windows: the guard of each time constant, by its name in `ir.memory`; empty after simplification,
            which merges and drops some of them.
    """

    guards: tuple[Guard, ...]
    actuators: tuple[ActuatorClients, ...]
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
