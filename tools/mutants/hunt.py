"""The hunt: a trial for every mutant, whatever is known already left out.

First, in one process that has collected all tests, the mutants that can be planted in functions there are.
The others, and those that survive although their function ran while modules were imported, have to be there
from the first import: each in a process that has nothing of `colony` yet.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

import pytest

from tools.mutants import planting, trial
from tools.mutants.baseline import ARGUMENTS, Baseline
from tools.mutants.mutation import Mutant
from tools.mutants.results import Results
from tools.mutants.scope import ROOT, SEEING_MOST
from tools.mutants.trial import Failing, Order, Tell, Verdict


@dataclass(frozen=True, slots=True)
class Hunt:
    """Mutants to try, by module. `budget_s`: for how long a mutant's tests may take, by the baseline."""

    todo: dict[str, list[Mutant]]
    tests: list[str]
    baseline: Baseline
    results: Results
    budget_s: float

    def order(self) -> Order:
        return Order(self.baseline, self.budget_s)

    def tell(self, path: str) -> None:
        """How far it has come."""
        counts = sorted(self.results.counts(path).items())
        text = ", ".join(f"{number} {status}" for status, number in counts)
        print(f"{path}: {text}", file=sys.__stdout__, flush=True)


def hunt(what: Hunt) -> None:
    """Try all mutants; the results tell what came of each, and are written as they come.

    Raises:
        SystemExit: the tests cannot be collected, or one fails without a mutant.
    """
    if not any(what.todo.values()):
        return
    child = os.fork()
    if not child:
        code = pytest.main([*ARGUMENTS, *what.tests], plugins=[Failing(), _Planted(what)])
        os._exit(code)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        raise SystemExit("the tests cannot be collected, or fail without a mutant")
    what.results.reload()
    import hypothesis.strategies  # noqa: F401  (here, so that each process need not)
    import msgspec  # noqa: F401
    import networkx  # noqa: F401

    for path, mutants in what.todo.items():
        order, left = what.order(), [mutant for mutant in mutants if not what.results.has(mutant)]
        for mutant in left:
            what.results.add(mutant, _imported(what, order, mutant))
        if left:
            what.tell(path)


# --- planted where all is imported ---------------------------------------------------------------------


class _Planted:
    """A plugin: in place of running the tests, plants mutants, and runs those tests that may tell."""

    def __init__(self, what: Hunt) -> None:
        self._what = what
        self._items: dict[str, pytest.Item] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        what = self._what
        self._items = {item.nodeid: item for item in session.items}
        self._failing = next(p for p in session.config.pluginmanager.get_plugins() if isinstance(p, Failing))
        self._imported = planting.Imported.so_far({str(ROOT / path) for path in what.todo})
        _draw_ahead()
        gc.collect()
        gc.freeze()  # so that no collection in a trial copies all pages
        for path, mutants in what.todo.items():
            if mutants:
                original, order = (ROOT / path).read_text(), what.order()
                self._try_none(path, original, order)
                for mutant in mutants:
                    self._try(mutant, original, order)
                what.tell(path)
        return True

    def _try_none(self, path: str, original: str, order: Order) -> None:
        """Planting a module's own functions must kill nothing: else kills would mean nothing."""
        names, file = order.of(self._what.baseline.tests_of(path)), str(ROOT / path)

        def work(tell: Tell) -> None:
            for code in planting.outermost(original, file):
                planting.plant(self._imported, file, code, code, original)
            self._run(names, tell)

        verdict = trial.forked(work)
        if verdict.status != "survived":
            raise AssertionError(f"{path}: {verdict.by or verdict.status} without a mutant")

    def _try(self, mutant: Mutant, original: str, order: Order) -> None:
        """Try a mutant that can be planted, and note what is certain of it."""
        what, file = self._what, str(ROOT / mutant.path)
        change = planting.changed_function(file, original, mutant.source)
        if change is None:
            return
        was, now = change
        names = order.of(_tests_for(what.baseline, mutant, was))
        at_import = what.baseline.runs_at_import(mutant.path, *_body(was))

        def work(tell: Tell) -> None:
            if not planting.plant(self._imported, file, was, now, mutant.source):
                os._exit(1)  # and tells of no test
            self._run(names, tell)

        verdict = trial.forked(work) if names else Verdict("untested")
        if verdict.status == "killed" and verdict.by not in what.baseline.seconds:
            return
        if verdict.status == "killed":
            order.kills[verdict.by] += 1
        if verdict.status in ("killed", "timeout") or not at_import:
            what.results.add(mutant, verdict)

    def _run(self, names: list[str], tell: Tell) -> None:
        self._failing.tell = tell
        trial.run([self._items[name] for name in names], self._what.baseline)


def _tests_for(baseline: Baseline, mutant: Mutant, function: CodeType) -> set[str]:
    """The tests that run the line; where that is not known, those that run the function.

    Those that see most are tried in any case: of what is cached only the first test runs the lines.
    """
    first, last = _body(function)
    on_line = baseline.tests(mutant.path, mutant.line, mutant.line) if mutant.line >= first else set()
    known = on_line or baseline.tests(mutant.path, first, last)
    return known | {test for test in baseline.tests_of(mutant.path) if test.startswith(SEEING_MOST)}


def _body(function: CodeType) -> tuple[int, int]:
    """The first and last line of a function, without the line of its `def` where there are more."""
    lines = set(_lines(function))
    return min(lines - {function.co_firstlineno}, default=function.co_firstlineno), max(lines)


def _lines(function: CodeType) -> Iterator[int]:
    yield from (line for _, _, line in function.co_lines() if line)
    for constant in function.co_consts:
        if isinstance(constant, CodeType):
            yield from _lines(constant)


def _draw_ahead() -> None:
    """What tests need and no mutant changes: runs that are drawn, and what should come of them."""
    from tests.verify.testing.test_drawn_runs import draw_all

    draw_all()


# --- there from the first import -----------------------------------------------------------------------


def _imported(what: Hunt, order: Order, mutant: Mutant) -> Verdict:
    names = order.of(what.baseline.tests_of(mutant.path))
    module = mutant.path.removesuffix(".py").replace("/", ".")
    limit = 20.0 + 10 * sum(what.baseline.seconds[name] for name in names)

    def work(tell: Tell) -> None:
        planting.Importing.install(Path(ROOT / mutant.path), module, mutant.source)
        trial.at_most(limit)
        if pytest.main([*ARGUMENTS, *names], plugins=[Failing(tell), _InOrder(names)]):
            tell("the tests cannot be imported")

    verdict = trial.forked(work)
    if verdict.by in what.baseline.seconds:
        order.kills[verdict.by] += 1
    return verdict


class _InOrder:
    """A plugin: the tests in this order."""

    def __init__(self, names: list[str]) -> None:
        self._places = {name: at for at, name in enumerate(names)}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: self._places.get(item.nodeid, len(self._places)))
