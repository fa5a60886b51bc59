"""The result of a comparison of two behaviors, as data."""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.frame import Outcome
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Matching:
    """The correspondence of A's and B's modules with equal content, whatever their names.

    Modules in `changed` have the same name in both programs and differ; those in `only_a` and `only_b` have
    no counterpart. `declarations` lists the params, derived values and limits that are written differently,
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
    """Every compared actuator is sent the same in every frame of every run.

    If `by_content` is true, the programs are written in the same way, except for names. Otherwise this is
    proved by `k`-induction; `over_reals` lists the expressions for which the proof uses reals, and floats may
    round.
    """

    matching: Matching
    by_content: bool
    k: int = 0
    over_reals: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Different:
    """A run in whose last frame the actuators in `actuators` are sent different commands.

    It is the shortest run found. Within the search's depth, if nothing is abstracted, there is no shorter
    one.

    `snapshots` are the inputs, in `snapshots_b` with B's names of modules; `a` and `b` are the reference
    interpreter's outcomes for each program; `needed_missing` are sensors that must be missing, `could_change`
    missing ones of which some readings would end the difference. `actuators` are pairs: A's name, B's name.
    """

    matching: Matching
    actuators: tuple[tuple[str, str], ...]
    snapshots: tuple[Snapshot, ...]
    snapshots_b: tuple[Snapshot, ...]
    a: tuple[Outcome, ...]
    b: tuple[Outcome, ...]
    needed_missing: tuple[str, ...] = ()
    could_change: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferenceUndecided:
    """Neither equality nor a difference was shown; `because` lists reasons, `hint` suggests a remedy."""

    matching: Matching
    because: tuple[str, ...]
    hint: str


Result = Same | Different | DifferenceUndecided
