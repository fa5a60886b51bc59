"""The result of a comparison of two behaviors, as data."""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.frame import Outcome
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Matching:
    """The correspondence of A's and B's modules: equal reads and equal actions, whatever their names.

    Modules in `changed` have the same name in both and differ; those in `only_a` and `only_b` have no
    counterpart. `declarations` lists the params, derived values and limits that are written differently,
    `notes` the parts of the two files that were not compared.
    """

    same: tuple[tuple[str, str], ...] = ()
    changed: tuple[str, ...] = ()
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()
    declarations: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Same:
    """Each actuator compared is sent the same in every frame of every run.

    `by_content`: they are written the same way, names aside. Otherwise it is proved by `k`-induction, and
    `over_reals` are the places where that was done for real numbers and floats may round.
    """

    matching: Matching
    by_content: bool
    k: int = 0
    over_reals: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Different:
    """A run in whose last frame the actuators in `actuators` are sent different commands.

    It has as few frames as were found. Within the search's depth, and where nothing is abstracted, there is
    no shorter one.

    `snapshots` are the inputs, `a` and `b` the reference interpreter's outcomes for either program;
    `needed_missing` are sensors that must be missing. `actuators` are pairs: A's name, B's name.
    """

    matching: Matching
    actuators: tuple[tuple[str, str], ...]
    snapshots: tuple[Snapshot, ...]
    a: tuple[Outcome, ...]
    b: tuple[Outcome, ...]
    needed_missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided:
    """Neither equality nor a difference was shown; `because` gives a reason a line, `hint` what to do."""

    matching: Matching
    because: tuple[str, ...]
    hint: str


Result = Same | Different | Undecided
