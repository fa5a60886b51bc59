"""Modules written in Python: the argument of `step`, and the check of its answer.

The classes use only `math` and `intake`, as the Python backend copies them into generated programs.
"""

from __future__ import annotations

from typing import NoReturn

from colony.execute.intake import as_float


class StepInput(dict[str, object]):
    """The argument of a module's `step`: a read-only mapping from the names that it reads to their values.

    Values are in base units (mm, s, deg), arrays are tuples; `t` is in seconds since the first frame.
    """

    __slots__ = ("t",)
    t: float

    def __init__(self, t: float, values: dict[str, object]) -> None:
        dict.__init__(self, values)
        object.__setattr__(self, "t", t)

    def _refused(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("a snapshot cannot be changed")

    __setattr__ = __delattr__ = __setitem__ = __delitem__ = __ior__ = _refused
    clear = pop = popitem = setdefault = update = _refused


class PythonStep:
    """One Python module: its object and, if it has a rate, the current answer and the next one.

    `fields` are those of the command, each with its name, and False for a bool, None for a number, or the
    numbers of the members for an enum. An answer is a tuple in this order; None means "not applicable", and
    False that there is none. Times are in ns since the first frame. An answer may leave out the fields that
    `defaults` has.
    """

    __slots__ = (
        "_defaults",
        "_fields",
        "_module",
        "_names",
        "_nothing",
        "_object",
        "_rate",
        "due",
        "pending",
        "standing",
    )

    def __init__(
        self,
        module: str,
        instance: object,
        fields: tuple[tuple[str, object], ...],
        rate: int | None,
        defaults: dict[str, float | bool] | None = None,
    ) -> None:
        self._defaults = defaults or {}
        self._module = module
        self._object = instance
        self._fields = fields
        self._names = {name for name, _ in fields}
        self._nothing = tuple([False if of is False else 0.0 for _, of in fields])
        self._rate = rate
        self.due = 0
        self.pending: tuple[int, tuple[float | bool, ...] | bool | None] | None = None
        self.standing: tuple[float | bool, ...] | bool | None = False

    def step(
        self, t: int, values: dict[str, object] | None, records: tuple[tuple[str, str], ...]
    ) -> tuple[bool, bool, tuple[float | bool, ...], tuple[tuple[str, str], ...]]:
        """Return whether the module has a command, whether it is blind, the fields, and the records.

        It is blind without an answer: `values` is None, something that it reads is missing (it is then not
        called, and no former answer counts any more), its last call failed, or it has not answered yet. The
        fields are placeholders if it has no command.
        """
        if values is None:
            self.pending, self.standing = None, False
            return False, True, self._nothing, records
        if self._rate is None:
            answer, records = self._call(t, values, records)
        else:
            self._promote(t)
            if t >= self.due:
                answer, records = self._call(t, values, records)
                self.due = t + self._rate
                self.pending = (self.due, answer)
                self._promote(t)
            answer = self.standing
        if answer is None or isinstance(answer, bool):
            return False, answer is not None, self._nothing, records
        return True, False, answer, records

    def _promote(self, t: int) -> None:
        if self.pending is not None and self.pending[0] <= t:
            self.standing = self.pending[1]
            self.pending = None

    def _call(
        self, t: int, values: dict[str, object], records: tuple[tuple[str, str], ...]
    ) -> tuple[tuple[float | bool, ...] | bool | None, tuple[tuple[str, str], ...]]:
        try:
            return self._answer(self._object.step(StepInput(t / 1e9, values))), records  # type: ignore[attr-defined]
        except Exception:
            return False, (*records, ("python error", self._module))

    def _answer(self, result: object) -> tuple[float | bool, ...] | None:
        """Return the fields in order; raise TypeError unless `result` has these, each of its type."""
        if result is None:
            return None
        if not hasattr(result, "keys"):
            raise TypeError("not the fields of a command")
        given = self._defaults | {name: result[name] for name in result}  # type: ignore[attr-defined,index]
        if set(given) != self._names:
            raise TypeError("not the fields of the command")
        answer: list[float | bool] = []
        for name, of in self._fields:
            value = given[name]
            if of is False:
                if not isinstance(value, bool):
                    raise TypeError(name)
                answer.append(value)
                continue
            number = as_float(value)
            if number is None and isinstance(value, float) and of is None:
                number = float(value)  # NaN: a command that is not finite is a fault of its own
            if number is None or (of is not None and number not in of):  # type: ignore[operator]
                raise TypeError(name)
            answer.append(number)
        return tuple(answer)
