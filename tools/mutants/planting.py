"""Plants a mutant in modules that are imported already, or in the import of one.

A mutant differs in one function, mostly. Its code object then takes the place of the original's in every
function object there is, wherever references to it went meanwhile (tables, decorators, other modules): in
milliseconds, in a process that has everything imported. What differs in the text around functions (a table, a
default, a base class) only shows when the module is imported, so there the mutant's text stands in for the
module's in a process that has not imported it yet.
"""

from __future__ import annotations

import gc
import importlib.abc
import importlib.machinery
import importlib.util
import inspect
import linecache
import sys
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import _lru_cache_wrapper
from pathlib import Path
from types import CodeType, FunctionType, ModuleType


@dataclass(frozen=True, slots=True)
class Imported:
    """What this process has imported: function objects by file, qualified name and first line, and caches."""

    functions: dict[tuple[str, str, int], list[FunctionType]]
    caches: list[_lru_cache_wrapper[object]]

    @classmethod
    def so_far(cls, files: set[str]) -> Imported:
        """All functions that were made of the text of these files, and the caches of `colony`."""
        functions: dict[tuple[str, str, int], list[FunctionType]] = {}
        caches = []
        for thing in gc.get_objects():
            if type(thing) is FunctionType and thing.__code__.co_filename in files:
                code = thing.__code__
                key = (code.co_filename, code.co_qualname, code.co_firstlineno)
                functions.setdefault(key, []).append(thing)
            elif type(thing) is _lru_cache_wrapper and (thing.__module__ or "").startswith("colony"):
                caches.append(thing)
        return cls(functions, caches)


def changed_function(file: str, original: str, mutant: str) -> tuple[CodeType, CodeType] | None:
    """The outermost function that differs, as it was and is; None where something else differs."""
    old, new = (compile(text, file, "exec", dont_inherit=True) for text in (original, mutant))
    if _frame_of(old) != _frame_of(new):
        return None
    pairs = zip(_outermost(old), _outermost(new), strict=True)
    differing = [(was, now) for was, now in pairs if _meaning(was) != _meaning(now)]
    return differing[0] if len(differing) == 1 else None


def plant(imported: Imported, file: str, was: CodeType, now: CodeType, source: str) -> bool:
    """Put `now` in the place of `was`; False where that cannot be done.

    `source` becomes the text of the file for those that ask for it, and what was cached is forgotten.
    """
    functions = imported.functions
    key = (file, was.co_qualname, was.co_firstlineno)
    inner = f"{was.co_qualname}.<locals>."
    if key not in functions or any(f == file and name.startswith(inner) for f, name, _ in functions):
        return False
    if any(len(function.__code__.co_freevars) != len(now.co_freevars) for function in functions[key]):
        return False
    for function in functions[key]:
        function.__code__ = now
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    for cache in imported.caches:
        cache.cache_clear()
    return True


def outermost(source: str, file: str) -> Iterator[CodeType]:
    """The functions of a module, and those of its classes, as their code."""
    yield from _outermost(compile(source, file, "exec", dont_inherit=True))


def _outermost(code: CodeType) -> Iterator[CodeType]:
    """The functions of a module, and those of its classes."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            if constant.co_flags & inspect.CO_OPTIMIZED:
                yield constant
            else:
                yield from _outermost(constant)


def _frame_of(code: CodeType) -> Hashable:
    """What a module or class does apart from what its functions do; comprehensions count as its own."""
    parts: list[Hashable] = [code.co_code, code.co_names, code.co_exceptiontable]
    for constant in code.co_consts:
        if not isinstance(constant, CodeType):
            parts.append((type(constant), repr(constant)))
        elif not constant.co_flags & inspect.CO_OPTIMIZED:
            parts.append(_frame_of(constant))
        elif constant.co_name.endswith("comp>") or constant.co_name == "<genexpr>":
            parts.append(_meaning(constant))
    return tuple(parts)


def _meaning(code: CodeType) -> Hashable:
    """All of a function but the numbers of its lines."""
    constants = tuple(
        _meaning(constant) if isinstance(constant, CodeType) else (type(constant), repr(constant))
        for constant in code.co_consts
    )
    names = (code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    arguments = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    return names, arguments, code.co_code, code.co_exceptiontable, constants


class Importing(importlib.abc.MetaPathFinder, importlib.abc.SourceLoader):  # type: ignore[misc]  # typeshed's bases differ
    """Gives one module another text when it is imported; to be put first into `sys.meta_path`."""

    def __init__(self, path: Path, name: str, source: str) -> None:
        self._path, self._name, self._source = path, name, source
        linecache.cache[str(path)] = (len(source), None, source.splitlines(keepends=True), str(path))

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self)

    def get_filename(self, fullname: str) -> str:
        return str(self._path)

    def get_data(self, path: str | bytes) -> bytes:
        if str(path) != str(self._path):
            raise OSError("no bytecode of a mutant")
        return self._source.encode()

    @staticmethod
    def install(path: Path, name: str, source: str) -> None:
        """From now on in this process; the module must not be imported yet."""
        assert name not in sys.modules, f"{name} is imported already"
        sys.meta_path.insert(0, Importing(path, name, source))
