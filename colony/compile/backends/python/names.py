"""Names in a generated program: unique, and close to those in the source."""

from __future__ import annotations

import builtins
import keyword
import math
import re

from colony.execute.code import Code

_RESERVED = frozenset({*dir(builtins), *keyword.kwlist, *keyword.softkwlist, *dir(math)})
_RESERVED_VARIABLES = frozenset(
    {
        "self",
        "first_ns",
        "step",
        "t",
        "t_ns",
        "readings",
        "taken_ns",
        "restarted",
        "records",
        "breaches",
        "reading",
        "settled",
        "fault",
    }
)


class Names:
    """Names of variables and attributes. Stateful: remembers all names, so that each is unique."""

    def __init__(self, code: Code, taken: frozenset[str]) -> None:
        """Reserve the names of the functions that the program includes (`taken`)."""
        self._taken = {*_RESERVED, *_RESERVED_VARIABLES, *taken}
        self._hints = code.names
        self.sensors = {s.name: self.new(s.name) for s in code.sensors}
        self.last = {s.name: self.new(f"kept_{s.name}") for s in code.sensors if s.sent is not None}
        self.fresh = {s.name: self.new(f"has_{s.name}") for s in code.sensors}
        self.python = {c.module: self.new(f"python_{c.module}") for c in code.python}
        self.python_active = {c.module: self.new(f"{c.module}_active") for c in code.python}
        self.python_blind = {c.module: self.new(f"{c.module}_blind") for c in code.python}
        self.python_fields = {c.module: self.new(f"{c.module}_fields") for c in code.python}
        self.decision = {a.actuator.name: self.new(a.actuator.name) for a in code.actuators}
        self.by = {a.actuator.name: self.new(f"{a.actuator.name}_by") for a in code.actuators}
        self.blind = {a.actuator.name: self.new(f"{a.actuator.name}_blind") for a in code.actuators}
        self.commanded = {a.actuator.name: self.new(f"{a.actuator.name}_commanded") for a in code.actuators}
        self.field = {
            (a.actuator.name, i): self.new(f"{a.actuator.name}_{f.name}")
            for a in code.actuators
            for i, f in enumerate(a.actuator.fields)
        }
        self.bounds = {a.actuator.name: self.new(f"{a.actuator.name}_bounds") for a in code.actuators}
        self.cells = [self.new(c.name) for c in code.cells]

    def value(self, number: int) -> str:
        """Return a new name for a value of the `Code`."""
        return self.new(self._hints.get(number, f"v{number}"))

    def new(self, wanted: str) -> str:
        """Return `wanted` as an identifier, with a number appended if it is taken."""
        base = re.sub(r"\W", "_", wanted)
        if not base.isascii() or not base.isidentifier() or base.startswith("_"):
            base = "v" + re.sub(r"[^A-Za-z0-9_]", "_", base)
        name, n = base, 2
        while name in self._taken:
            name, n = f"{base}_{n}", n + 1
        self._taken.add(name)
        return name
