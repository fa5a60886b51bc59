"""What came of a comparison of two behaviors, as data."""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.frame import Outcome
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Matching:
    """Which modules of A are which of B: those that read the same and do the same, whatever their names.

    `changed` have one name in both and differ; `only_a` and `only_b` have no counterpart at all.
    `declarations` says which params, derived values and limits are written otherwise, `notes` what the two
    files have besides and was not compared.
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
    """A run, of as few frames as were found, in whose last frame the actuators in `actuators` are sent
    different commands. Within the search's depth, and where nothing is abstracted, there is no shorter one.

    `snapshots` are what is given, `a` and `b` what the reference interpreter makes of it by either program;
    `needed_missing` are sensors that must not be there. `actuators` are pairs: A's name, B's name.
    """

    matching: Matching
    actuators: tuple[tuple[str, str], ...]
    snapshots: tuple[Snapshot, ...]
    a: tuple[Outcome, ...]
    b: tuple[Outcome, ...]
    needed_missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided:
    """Neither shown the same nor told apart; `because` says why, a reason a line, and `hint` what to do."""

    matching: Matching
    because: tuple[str, ...]
    hint: str


Result = Same | Different | Undecided
