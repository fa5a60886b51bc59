"""Lint of safeguards that fail open: without a sensor that only the safeguard reads, the robot drives on.

A *safeguard* of a module m is a module that dominates m somewhere and either inhibits m or, whenever both are
active, restrains a field of m's command. It restrains a field if its own value for the field is the idle
value, lies on the other side of the idle value or, for a speed, lies nearer to it. The evidence is a pair of
runs that differ in one sensor of the last frame only. With all sensors present, the safeguard is active and m
does not win; with that sensor missing, m wins with a command that is not idle. A failsafe safeguard does not
fail open: it is active then too.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.expression import Expression
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.lints.case import Case
from colony.verify.lints.driving import (
    Found,
    Guarded,
    by_guards,
    dominators,
    drivers,
    guarded_fields,
    inhibitor_hint,
    may_win_without,
    moving_fields,
    undecided_without,
    without,
)
from colony.verify.lints.evidence import replay
from colony.verify.lints.proof import Effort, Prover

_MAX_EAGER = 16
"""Number of pairs and sensors up to which the claims about guards are encoded with all others."""


def _pairs(case: Case) -> Iterator[Guarded]:
    """Yield each module that moves the robot with each ordinary dominator that needs further sensors."""
    for module, actuator in drivers(case):
        for name in dominators(case, module):
            guard = case.wired_modules[name]
            if not guard.failsafe:
                sensors = case.contents.needs(guard) - case.contents.needs(module)
                yield Guarded(module, actuator, guard, tuple(sorted(sensors)))


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module never wins while only this sensor is missing, and a few more.

    Those about guards take longer to encode, and few modules can win without a sensor of their guards: of a
    large program they are encoded only where they are asked.
    """
    pairs = list(_pairs(case))
    for pair in pairs:
        yield from pair.open_claims(case)
        if _are_few(pairs):
            yield from pair.claims(case)


def _are_few(pairs: list[Guarded]) -> bool:
    return sum(len(pair.sensors) for pair in pairs) <= _MAX_EAGER


def findings(case: Case, prover: Prover, effort: Effort) -> Iterator[Diagnostic]:
    """Yield the warnings about guards that fail open."""
    found: Found = {}
    undecided: dict[str, list[str]] = {}
    all_pairs = list(_pairs(case))
    pairs = [p.only(s for s in p.sensors if may_win_without(p.module, s, prover)) for p in all_pairs]
    asked = prover
    if not _are_few(all_pairs):
        open_claims = (claim for p in pairs if p.sensors for claim in p.claims(case))
        asked = Prover(case.instrumented, dict(open_claims), effort)
    for pair in pairs:
        fields = guarded_fields(case, pair.module, pair.guard, pair.actuator, asked) if pair.sensors else ()
        for sensor in pair.sensors if fields else ():
            trace = asked.refuted(pair.claim(sensor))
            if trace is None:
                if asked.is_undecided(pair.claim(sensor)):
                    undecided.setdefault(pair.module.name, []).append(sensor)
                continue
            outcome = replay(case.program, without(trace.snapshots, sensor))[-1]
            if moving_fields(outcome, pair.module, pair.actuator).intersection(fields):
                found.setdefault(((pair.module.name,), sensor), []).append(pair.guard.name)
    yield from _warnings(case, found)
    yield from undecided_without(case, undecided, ((module, sensor) for (module,), sensor in found))


def _warnings(case: Case, found: Found) -> Iterator[Diagnostic]:
    """Yield a warning for each module and set of guards."""
    for (module,), names, sensors in by_guards(found):
        is_single = len(names) == 1
        what = "them" if len(sensors) > 1 else "it"
        silent = (
            f"which {'reads' if is_single else 'read'} {what}, {'is' if is_single else 'are'} silent then"
        )
        cure = f"write {quoted([f'failsafe module {name}' for name in names])}"
        yield warning(
            "V030",
            case.modules[module].span,
            f"with {quoted(sensors, 'or')} missing, `{module}` can drive: {quoted(names)}, {silent}",
            f"{cure}, or {inhibitor_hint(sensors, module)}",
        )
