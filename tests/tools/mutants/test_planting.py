"""A mutant acts wherever the function is known, and only in the function."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from tools.mutants import planting, trial
from tools.mutants.baseline import Baseline

TEXT = '''from functools import cache

LIMIT = 3


def over(x, by=1):
    """Whether."""
    return any(x > LIMIT + by * k for k in range(2))


TABLE = {"over": over, "same": lambda x: x}


class Shop:
    price = 7

    @property
    def dear(self):
        return over(self.price)

    @staticmethod
    def name():
        return "shop"


def maker():
    def made(x):
        return x + 1

    return made


MADE = maker()
'''


@pytest.fixture
def shop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    (tmp_path / "planted_shop.py").write_text(TEXT)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module("planted_shop")
    del sys.modules["planted_shop"]


def plant(shop: ModuleType, old: str, new: str) -> bool:
    """Whether a change of the text could be planted."""
    assert shop.__file__ is not None
    source = TEXT.replace(old, new, 1)
    assert source != TEXT
    change = planting.changed_function(shop.__file__, TEXT, source)
    imported = planting.Imported.so_far({shop.__file__})
    return change is not None and planting.plant(imported, shop.__file__, *change, source)


def test_a_function_changes_wherever_it_is_known(shop: ModuleType) -> None:
    known, dear = shop.TABLE["over"], shop.Shop()
    assert plant(shop, "x > LIMIT", "x < LIMIT")
    assert not known(7)
    assert not dear.dear
    assert "x < LIMIT" in inspect.getsource(shop)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("return over(self.price)", "return None", lambda shop: shop.Shop().dear is None),
        ('return "shop"', 'return "SHOP"', lambda shop: shop.Shop.name() == "SHOP"),
        ("lambda x: x}", "lambda x: None}", lambda shop: shop.TABLE["same"](1) is None),
    ],
)
def test_properties_static_methods_and_lambdas(shop: ModuleType, old: str, new: str, told) -> None:
    assert not told(shop)
    assert plant(shop, old, new)
    assert told(shop)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),  # a table of the module
        ("by=1", "by=2"),  # a default
        ("price = 7", "price = 8"),  # of a class
        ("return x + 1", "return x - 1"),  # of a function that was made when the module was imported
    ],
)
def test_what_shows_only_at_import_is_not_planted(shop: ModuleType, old: str, new: str) -> None:
    assert not plant(shop, old, new)
    assert (shop.LIMIT, shop.Shop.price, shop.MADE(1), shop.over(5)) == (3, 7, 2, True)


def test_what_is_cached_is_forgotten() -> None:
    calls = []

    @cache
    def counted() -> int:
        calls.append(1)
        return len(calls)

    counted.__module__ = "colony.pretended"
    imported = planting.Imported.so_far(set())
    assert counted() == counted() == 1
    assert counted in imported.caches


def test_a_mutant_may_be_there_from_the_first_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "imported_shop.py"
    path.write_text(TEXT)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    planting.Importing.install(path, "imported_shop", TEXT.replace("LIMIT = 3", "LIMIT = 30"))
    shop = importlib.import_module("imported_shop")
    assert not shop.over(7)
    assert "LIMIT = 30" in inspect.getsource(shop)
    del sys.modules["imported_shop"]


# --- trials --------------------------------------------------------------------------------------------


def _spin(tell: trial.Tell) -> None:
    trial.at_most(0.05)
    while True:
        pass


def test_a_trial_tells_what_became_of_it() -> None:
    assert trial.forked(lambda tell: None) == trial.Verdict("survived")
    assert trial.forked(lambda tell: tell("test_x")) == trial.Verdict("killed", "test_x")
    assert trial.forked(lambda tell: os._exit(1)) == trial.Verdict("killed", "")
    assert trial.forked(_spin) == trial.Verdict("timeout")


def test_tests_that_kill_come_first_and_short_ones_before_long_ones() -> None:
    order = trial.Order(Baseline({"long": 3.0, "short": 0.1, "middle": 1.0}, {}, {}), budget_s=2.0)
    assert order.of(["long", "middle", "short"]) == ["short", "middle"]
    order.kills["middle"] += 1
    assert order.of(["long", "middle", "short"]) == ["middle", "short"]
    assert order.of(["long"]) == ["long"]
