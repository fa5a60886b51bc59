"""Comparison of what two programs send: by their content, by induction, or by a run in which they differ.

Only what the actuators receive is compared: the values sent, those of the idle command included, or that
nothing is sent (`idle hold`). The winning modules may differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from colony.ir import expression as ir
from colony.ir.expression import Binary
from colony.ir.frame import Outcome
from colony.ir.program import Actuator, Contract, Program
from colony.ir.types import BOOL, any_value
from colony.verify.claims import TRUE, all_of, any_of, binary, constant, won
from colony.verify.contracts.prove import Prover
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Options, Proved, Refuted, Trace, Unknown
from colony.verify.difference.compatible import Ignored, Pair, check_sensors, ignored, pairs
from colony.verify.difference.matching import matching
from colony.verify.difference.product import B_SUFFIX, Product, product
from colony.verify.difference.results import Different, Matching, Result, Same, Undecided
from colony.verify.difference.shortest import shortest
from colony.verify.snapshot import Snapshot

_SAME = "same commands"


def difference(
    a: Program,
    b: Program,
    ignore: Iterable[str] = (),
    actuators: Sequence[tuple[str, str]] = (),
    options: Options | None = None,
    clock: Callable[[], float] = lambda: 0.0,
) -> Result:
    """Compare what `a` and `b` send in every frame, for all sensor readings at all times.

    `ignore` names actuators, fields (`drive.turn`) and modules (frames in which they win are not compared).
    `actuators` are the pairs to compare, A's name and B's; by default, those of equal names.

    Raises:
        DiagnosticError: V040 to V042, where the two cannot be compared.
    """
    check_sensors(a, b)
    leave_out = ignored(a, b, ignore)
    compared = pairs(a, b, leave_out, actuators)
    both = product(a, b)
    found = matching(a, b, compared)
    open_ = [pair for pair in compared if not _same_content(pair, both)]
    if not open_:
        return Same(matching=found, by_content=True)
    contract = Contract(name=_SAME, expression=_claim(open_, leave_out, both))
    program = replace(both.program, contracts=(contract,))
    trace = Refuter(program, _SAME).draw()
    if trace is not None:
        return _different(
            a, b, both, compared, shortest(program, _SAME, trace, options or Options(), clock), found
        )
    match Prover(program, options or Options(), clock).prove(contract):
        case Proved(k=k, over_reals=over_reals):
            exact = _only_wired_otherwise(compared, both)
            return Same(matching=found, by_content=False, k=k, over_reals=() if exact else over_reals)
        case Refuted(trace=trace):
            return _different(a, b, both, compared, trace, found)
        case Unknown() as unknown:
            return _undecided(unknown, found)


def _same_content(pair: Pair, both: Product) -> bool:
    """Return True if an actuator has the same network, limits, ranges and idle command in both."""
    a, b = pair.a, pair.b
    same_root = both.roots.get(a.name) == both.roots.get(b.name + B_SUFFIX)
    return same_root and a.idle == b.idle and _same_bounds(pair, both)


def _same_bounds(pair: Pair, both: Product) -> bool:
    a, b = pair.a, pair.b
    return all(
        (x.low, x.high) == (y.low, y.high)
        and both.limits.get((a.name, i), ()) == both.limits.get((b.name + B_SUFFIX, i), ())
        for i, (x, y) in enumerate(zip(a.fields, b.fields, strict=True))
    )


def _only_wired_otherwise(compared: Sequence[Pair], both: Product) -> bool:
    """Return True if all modules and bounds are the same, so that both round every number alike."""
    program = both.program
    own = any(x.name.endswith(B_SUFFIX) for x in (*program.modules, *program.derived))
    return not own and all(_same_bounds(pair, both) for pair in compared)


# --- what is claimed -------------------------------------------------------------------------------


def _claim(compared: Sequence[Pair], leave_out: Ignored, both: Product) -> ir.Expression:
    same = all_of(part for pair in compared for part in _equal(pair))
    return any_of((*_excused(compared, leave_out, both), same))


def _equal(pair: Pair) -> Iterator[ir.Expression]:
    a, b = pair.a.name, pair.b.name + B_SUFFIX
    if pair.a.idle is None or pair.b.idle is None:
        yield binary(Binary.EQUAL, _sends(pair.a, a), _sends(pair.b, b))
    for i in pair.compared:
        yield binary(Binary.EQUAL, _sent(pair.a, i, a), _sent(pair.b, i, b))


def _sends(actuator: Actuator, name: str) -> ir.Expression:
    """Return the condition that anything is sent."""
    if actuator.idle is None:
        return ir.IsCommanded(type=BOOL, actuator=name)
    return TRUE


def _sent(actuator: Actuator, i: int, name: str) -> ir.Expression:
    """Return a field as it is sent; where nothing is sent, a stand-in value."""
    kind = actuator.fields[i].type
    sent = ir.SentField(type=kind, actuator=name, field_index=i)
    if actuator.idle is not None:
        return sent
    return ir.ValueOr(type=kind, expression=sent, other=constant(any_value(kind), kind))


def _excused(compared: Sequence[Pair], leave_out: Ignored, both: Product) -> Iterator[ir.Expression]:
    """Yield the conditions that an ignored module wins, in A or in B."""
    of_a = {m.name for m in both.program.modules if not m.name.endswith(B_SUFFIX)}
    for module in sorted(leave_out.modules):
        names = dict.fromkeys(
            name
            for name in (module if module in of_a else None, both.modules.get(module))
            if name is not None
        )
        for name in names:
            for pair in compared:
                for actuator in (pair.a.name, pair.b.name + B_SUFFIX):
                    yield won(actuator, name)


# --- what was found --------------------------------------------------------------------------------


def _different(
    a: Program, b: Program, both: Product, compared: Sequence[Pair], trace: Trace, found: Matching
) -> Result:
    """Return the outcomes of each program by itself over the trace, in which they must differ as well."""
    names_in_b = {in_product: in_b for in_b, in_product in both.modules.items()}
    by_a = Replay(a, "").run(trace.snapshots)
    by_b = Replay(b, "").run([_for_b(s, names_in_b) for s in trace.snapshots])
    differing = tuple((p.a.name, p.b.name) for p in compared if _sends_differently(p, by_a[-1], by_b[-1]))
    if not differing:
        because = ("the run that was found does not show a difference when each is run by itself",)
        return Undecided(matching=found, because=because, hint="this is a defect of `colony`: report it")
    return Different(
        matching=found,
        actuators=differing,
        snapshots=trace.snapshots,
        a=by_a,
        b=by_b,
        needed_missing=trace.needed_missing,
    )


def _for_b(snapshot: Snapshot, names_in_b: dict[str, str]) -> Snapshot:
    """Return a snapshot for B alone, with B's names for modules."""
    answers = {names_in_b[name]: fields for name, fields in snapshot.answers.items() if name in names_in_b}
    return snapshot._replace(answers=answers)


def _sends_differently(pair: Pair, a: Outcome, b: Outcome) -> bool:
    values_a = next(d.values for d in a.decisions if d.actuator == pair.a.name)
    values_b = next(d.values for d in b.decisions if d.actuator == pair.b.name)
    if values_a is None or values_b is None:
        return values_a != values_b
    return any(values_a[i] != values_b[i] for i in pair.compared)


def _undecided(unknown: Unknown, found: Matching) -> Undecided:
    because = unknown.because
    if unknown.trace is not None:
        because = (
            "they differ if modules in Python answer differently, and those that differ may answer anything",
            *because[1:],
        )
    return Undecided(matching=found, because=because, hint=_HINT)


_HINT = (
    "search longer with `--timeout` or further with `--depth`, or leave out with `--ignore` what may differ"
)
