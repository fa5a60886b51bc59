"""Commands last sent to actuators on `idle hold`, kept for the time after a restart of DServer.

Such an actuator keeps the value of its last command, which may be long ago: `last.ACTUATOR.FIELD` has that
value in a server that was restarted, too. Other actuators get a command in every frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import msgspec

from colony.ir.types import ScalarValue
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.store.store import Journal, Key


class _Sent(NamedTuple):
    run: str
    values: tuple[bool | float, ...]


class LastSent:
    """The last command of each actuator that holds, in base units. Mutable; changes go to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._run = ""
        self._sent: dict[str, _Sent] = {}

    def begin(self, run: str, actuators: Iterable[ActuatorSpec]) -> Mapping[str, tuple[ScalarValue, ...]]:
        """Begin or continue a run; return what these actuators were given in it, and drop the rest."""
        self._run = run
        names = {spec.name for spec in actuators if _is_kept(spec)}
        for name, sent in tuple(self._sent.items()):
            if sent.run != run or name not in names:
                del self._sent[name]
                self._journal.drop(Key("sent", name))
        return {name: sent.values for name, sent in self._sent.items()}

    def put(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> None:
        """Keep a command, if the actuator holds it and its frames report it."""
        if not _is_kept(actuator):
            return
        sent = _Sent(self._run, values)
        if repr(sent) != repr(self._sent.get(actuator.name)):  # 0.0 is not -0.0
            self._sent[actuator.name] = sent
            self._journal.put(Key("sent", actuator.name), _encode(sent))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the commands from the entries of a store."""
        for key, data in entries.items():
            if key.kind == "sent":
                self._sent[key.name] = _sent.decode(data)


def _is_kept(actuator: ActuatorSpec) -> bool:
    return actuator.idle is None and bool(actuator.reported)


_encode = msgspec.msgpack.Encoder().encode
_sent = msgspec.msgpack.Decoder(_Sent)
