"""Reactive robot behavior: modules wired through suppressors and inhibitors, as prioritized clients.

    >>> import colony
    >>> program = colony.loads('''
    ... robot toy {
    ...   sensor   bumper : bool from Base.bumper
    ...   actuator drive { velocity : mm/s range -600 .. 600 } to Base.drive idle drive(velocity = 0)
    ... }
    ... module cruise   { when true   do drive(velocity = 400 mm/s) }
    ... module back_off { when bumper do drive(velocity = -100 mm/s) }
    ... network { drive = back_off suppresses cruise }
    ... ''')
    >>> robot = colony.build(program).executor()
    >>> robot.step(colony.Frame(t_ns=0, readings={"bumper": True})).commands["drive"].by
    'back_off'

The names of this module are loaded on first use; `colony.testing` is for property tests. Everything else is
internal and may change. See docs/library.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from colony.ir.frame import Decision as Decision
    from colony.ir.frame import Frame as Frame
    from colony.ir.frame import Outcome as Outcome
    from colony.library import Build as Build
    from colony.library import CompiledProgram as CompiledProgram
    from colony.library import audit as audit
    from colony.library import build as build
    from colony.library import compare as compare
    from colony.library import load as load
    from colony.library import loads as loads
    from colony.library import prove as prove
    from colony.library import read as read
    from colony.library import recorded as recorded
    from colony.text.diagnostics import DiagnosticError as DiagnosticError

_NAMES_BY_MODULE = {
    "colony.text.diagnostics": ("DiagnosticError",),
    "colony.ir.frame": ("Decision", "Frame", "Outcome"),
    "colony.library": (
        *("Build", "CompiledProgram"),
        *("audit", "build", "compare", "load", "loads", "prove", "read", "recorded"),
    ),
}
_MODULE_OF = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}

__all__ = [*_MODULE_OF, "__version__"]


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'colony' has no attribute {name!r}")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
