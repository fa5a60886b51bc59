"""Comparison of what two programs send: by their content, by induction, or by a run in which they differ.

Only what the actuators receive is compared: the values sent, including idle commands, or that nothing is sent
(`idle hold`). The winning modules may differ.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from colony.ir import expression as ir
from colony.ir.expression import Binary
from colony.ir.frame import Outcome
from colony.ir.program import Actuator, Contract, Program
from colony.ir.types import BOOL
from colony.verify.claims import TRUE, all_of, any_of, binary, implies, won
from colony.verify.contracts.attempt import ProofContext
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.prove import ContractProver
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import ProofOptions, Proved, Refuted, Trace, Unknown
from colony.verify.contracts.search import Search, called_modules
from colony.verify.contracts.solver import Budget
from colony.verify.difference.matching import (
    IgnoredParts,
    Pair,
    check_sensors,
    find_ignored_parts,
    matching,
    pairs,
)
from colony.verify.difference.product import B_SUFFIX, Product, product
from colony.verify.difference.results import DifferenceUndecided, Different, Matching, Result, Same
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.encode import encode

# --- shortest -----------------------------------------------------------------------------------------
#
# Search for a run that breaks a claim and is shorter than a known one.


def shortest_trace(program: Program, contract: str, known_trace: Trace, options: ProofOptions) -> Trace:
    """Return a run that breaks the contract: a shorter one than `known_trace` if one is found in budget."""
    if len(known_trace.snapshots) == 1:
        return known_trace
    context, budget = ProofContext(encode(program)), Budget(options)
    search = Search(context.cones[contract], context.claims[contract], budget)
    refuter = Refuter(program, contract, called_modules(context.cones[contract]))
    for _ in range(len(known_trace.snapshots) - 1):
        for candidate in search.search_next_length(allow_python=False):
            trace = refuter.confirm(candidate, search)
            if trace is not None:
                return trace
            if not refuter.may_try_more(candidate):
                break
        if budget.is_spent():
            break
    return known_trace


# --- compare ------------------------------------------------------------------------------------------

_SAME = "same commands"


def difference(
    a: Program,
    b: Program,
    ignore: Iterable[str] = (),
    actuators: Sequence[tuple[str, str]] = (),
    options: ProofOptions | None = None,
) -> Result:
    """Compare what `a` and `b` send in every frame, for all sensor readings at all times.

    `ignore` names actuators, fields (`drive.turn`) and modules (frames in which they win are not compared).
    `actuators` are the pairs to compare, A's name and B's; by default, those of equal names.

    Raises:
        DiagnosticError: V040 to V042: the two cannot be compared.
    """
    check_sensors(a, b)
    ignored_parts = find_ignored_parts(a, b, ignore)
    compared = pairs(a, b, ignored_parts, actuators)
    combined = product(a, b)
    modules_matched = matching(a, b, compared)
    unequal = [pair for pair in compared if not _same_content(pair, combined)]
    if not unequal:
        return Same(matching=modules_matched, by_content=True)
    contract = Contract(name=_SAME, expression=_claim(unequal, ignored_parts, combined))
    program = replace(combined.program, contracts=(contract,))
    trace = Refuter(program, _SAME).search_runs()
    if trace is not None:
        trace = shortest_trace(program, _SAME, trace, options or ProofOptions())
        return _different(a, b, combined, compared, trace, modules_matched)
    match ContractProver(program, options or ProofOptions()).prove(contract):
        case Proved(k=k, over_reals=over_reals):
            exact = _differ_only_in_wiring(compared, combined)
            return Same(
                matching=modules_matched, by_content=False, k=k, over_reals=() if exact else over_reals
            )
        case Refuted(trace=trace):
            return _different(a, b, combined, compared, trace, modules_matched)
        case Unknown() as unknown:
            return _undecided(unknown, modules_matched)


def _same_content(pair: Pair, combined: Product) -> bool:
    """Return True if an actuator has the same network, limits, ranges and idle command in both programs."""
    a, b = pair.a, pair.b
    same_root = combined.roots.get(a.name) == combined.roots.get(b.name + B_SUFFIX)
    return same_root and a.idle == b.idle and _same_bounds(pair, combined)


def _same_bounds(pair: Pair, combined: Product) -> bool:
    a, b = pair.a, pair.b
    return all(
        (x.low, x.high) == (y.low, y.high)
        and sorted(combined.limits.get((a.name, i), ()))
        == sorted(combined.limits.get((b.name + B_SUFFIX, i), ()))
        for i, (x, y) in enumerate(zip(a.fields, b.fields, strict=True))
    )


def _differ_only_in_wiring(compared: Sequence[Pair], combined: Product) -> bool:
    """Return True if all modules and bounds are the same, so that both programs round all numbers alike."""
    program = combined.program
    has_own_parts = any(x.name.endswith(B_SUFFIX) for x in (*program.modules, *program.derived))
    return not has_own_parts and all(_same_bounds(pair, combined) for pair in compared)


# --- the claim -------------------------------------------------------------------------------------


def _claim(compared: Sequence[Pair], ignored_parts: IgnoredParts, combined: Product) -> ir.Expression:
    same = all_of(part for pair in compared for part in _equal(pair))
    return any_of((*_excused(compared, ignored_parts, combined), same))


def _equal(pair: Pair) -> Iterator[ir.Expression]:
    a, b = pair.a.name, pair.b.name + B_SUFFIX
    holds = pair.a.idle is None or pair.b.idle is None
    if holds:
        yield binary(Binary.EQUAL, _sends(pair.a, a), _sends(pair.b, b))
    for i in pair.field_indices:
        same = binary(Binary.EQUAL, _sent(pair.a, i, a), _sent(pair.b, i, b))
        yield implies(_sends(pair.a, a), same) if holds else same


def _sends(actuator: Actuator, name: str) -> ir.Expression:
    """Return the condition that a command is sent."""
    if actuator.idle is None:
        return ir.IsCommanded(type=BOOL, actuator=name)
    return TRUE


def _sent(actuator: Actuator, i: int, name: str) -> ir.Expression:
    """Return the value of a field that is sent."""
    return ir.SentField(type=actuator.fields[i].type, actuator=name, field_index=i)


def _excused(
    compared: Sequence[Pair], ignored_parts: IgnoredParts, combined: Product
) -> Iterator[ir.Expression]:
    """Yield the conditions that an ignored module wins, in A or in B."""
    names_in_a = {m.name for m in combined.program.modules if not m.name.endswith(B_SUFFIX)}
    for module in sorted(ignored_parts.modules):
        names = dict.fromkeys(
            name
            for name in (module if module in names_in_a else None, combined.modules.get(module))
            if name is not None
        )
        for name in names:
            for pair in compared:
                for actuator in (pair.a.name, pair.b.name + B_SUFFIX):
                    yield won(actuator, name)


# --- the result ------------------------------------------------------------------------------------


def _different(
    a: Program,
    b: Program,
    combined: Product,
    compared: Sequence[Pair],
    trace: Trace,
    modules_matched: Matching,
) -> Result:
    """Return the outcomes of each program run alone over the trace; these must differ as well."""
    names_in_b = {in_product: in_b for in_b, in_product in combined.modules.items()}
    by_a = Replay(a, "").run(trace.snapshots)
    snapshots_b = tuple(_for_b(s, names_in_b) for s in trace.snapshots)
    by_b = Replay(b, "").run(snapshots_b)
    differing = tuple((p.a.name, p.b.name) for p in compared if _sends_differently(p, by_a[-1], by_b[-1]))
    if not differing:
        because = ("the run that was found shows no difference when each behavior is run alone",)
        return DifferenceUndecided(
            matching=modules_matched, because=because, hint="this is a defect of `colony`: report it"
        )
    return Different(
        matching=modules_matched,
        actuators=differing,
        snapshots=trace.snapshots,
        snapshots_b=snapshots_b,
        a=by_a,
        b=by_b,
        needed_missing=trace.needed_missing,
        could_change=trace.could_change,
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
    return any(values_a[i] != values_b[i] for i in pair.field_indices)


def _undecided(unknown: Unknown, modules_matched: Matching) -> DifferenceUndecided:
    because = unknown.because
    if unknown.trace is not None:
        because = (
            "they differ if modules in Python answer differently, and those that differ may answer anything",
            *because[1:],
        )
    return DifferenceUndecided(matching=modules_matched, because=because, hint=_HINT)


_HINT = (
    "search longer with `--timeout` or further with `--depth`, or leave out with `--ignore` what may differ"
)
