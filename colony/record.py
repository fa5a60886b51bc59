"""Frozen, slotted dataclasses that are quick to declare.

The typed program and the syntax tree are more than a hundred small classes, and every command imports them.
`dataclasses.dataclass` compiles six methods for each frozen class, which would take a third of the time of
`colony check`. A `record` compiles only `__init__`, when its first instance is created, and inherits the
rest; it is a dataclass to `dataclasses.fields`, `dataclasses.replace`, pattern matching and type checkers.
"""

from __future__ import annotations

import inspect
from dataclasses import MISSING, FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from typing import Any, ClassVar, TypeVar, dataclass_transform

_Class = TypeVar("_Class")


class Record:
    """The base class of all records: equality and hash by the compared fields, and no assignment."""

    __slots__ = ()
    _compared: ClassVar[Any] = staticmethod(lambda self: ())

    def __eq__(self, other: object) -> bool:
        """Return True if the types and all compared fields are equal."""
        if type(self) is not type(other):
            return NotImplemented
        return bool(self._compared(self) == self._compared(other))

    def __hash__(self) -> int:
        """Return a hash of the type and the compared fields."""
        return hash((type(self), self._compared(self)))

    def __repr__(self) -> str:
        """Return the class name with the shown fields."""
        shown = (f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if f.repr)  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __setattr__(self, name: str, value: object) -> None:
        """Raise FrozenInstanceError."""
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> None:
        """Raise FrozenInstanceError."""
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __getstate__(self) -> tuple[Any, ...]:
        """Return the values of all fields."""
        return tuple(getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Set the values of all fields."""
        for f, value in zip(fields(self), state, strict=True):  # type: ignore[arg-type]
            object.__setattr__(self, f.name, value)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
def record(cls: type[_Class]) -> type[_Class]:
    """Make a subclass of `Record` a frozen, slotted dataclass with keyword-only fields.

    Defaults must be immutable values; `field(default=..., compare=..., repr=...)` is supported.
    """
    class_: Any = dataclass(init=False, repr=False, eq=False, kw_only=True)(cls)
    declared = fields(class_)
    own = inspect.get_annotations(cls)
    body = {k: v for k, v in class_.__dict__.items() if k not in own and k not in ("__dict__", "__weakref__")}
    body["__slots__"] = tuple(f.name for f in declared if f.name in own and f.name not in _inherited(cls))
    slotted: Any = type(cls.__name__, cls.__bases__, body)
    slotted.__qualname__ = cls.__qualname__
    names = [f.name for f in declared if f.compare]
    if names:
        slotted._compared = staticmethod(attrgetter(*names))

    def initialize_first(self: Any, **values: Any) -> None:
        slotted.__init__ = _initializer(slotted, declared)  # compiled only for classes with instances
        slotted.__init__(self, **values)

    slotted.__init__ = initialize_first
    result: type[_Class] = slotted
    return result


def _inherited(cls: type) -> set[str]:
    return {name for base in cls.__mro__[1:] for name in base.__dict__.get("__slots__", ())}


def _initializer(cls: type, declared: tuple[Any, ...]) -> Any:
    """Return an `__init__` that sets the slots directly, bypassing `__setattr__`."""
    parameters: list[str] = []
    lines: list[str] = []
    names: dict[str, Any] = {}
    for f in declared:
        names[f"set_{f.name}"] = getattr(cls, f.name).__set__
        if f.default is not MISSING:
            names[f"default_{f.name}"] = f.default
        parameters.append(f.name if f.default is MISSING else f"{f.name}=default_{f.name}")
        lines.append(f" set_{f.name}(self, {f.name})")
    head = (
        f"def __init__(self, *, {', '.join(parameters)}):\n" if parameters else "def __init__(self):\n pass\n"
    )
    exec(head + "\n".join(lines), names)
    initializer = names["__init__"]
    initializer.__qualname__ = f"{cls.__qualname__}.__init__"
    return initializer
