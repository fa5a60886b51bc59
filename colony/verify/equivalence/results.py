"""Results of a proof of equivalence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from colony.text.wording import counted, duration_text, listed


@dataclass(frozen=True, slots=True, kw_only=True)
class EquivalenceProved:
    """A proof: all of `obligations` hold.

    `by_structure` of them hold because rules of Boolean algebra alone made both sides the same formula,
    `by_solver` with the help of z3, which was asked `questions` times. `forms` names what was proved: the
    clients, and the forms emitted from them.
    """

    forms: tuple[str, ...]
    by_structure: int
    by_solver: int
    questions: int

    @property
    def obligations(self) -> int:
        """The number of obligations that hold."""
        return self.by_structure + self.by_solver


@dataclass(frozen=True, slots=True, kw_only=True)
class Activation:
    """A frame: the modules that are active now, and the activities that a time constant remembers.

    Nothing else is active or was active before.
    """

    active: tuple[str, ...]
    recent: tuple[Recent, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Recent:
    """The module or wire `name` was last active at least `min_age_ns` and less than `max_age_ns` ago."""

    name: str
    min_age_ns: int
    max_age_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongWinner:
    """A frame in which the wrong module commands `actuator`, compared with the network.

    `by_priority` is the first client whose guard holds, `by_exclusive` are all clients whose exclusive guard
    holds (None if the form has no exclusive guards).
    """

    form: str
    actuator: str
    frame: Activation
    network: str | None
    by_priority: str | None
    by_exclusive: tuple[str, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongActivity:
    """A frame in which the compiled activity of `name`, which contracts read, is wrong."""

    form: str
    name: str
    frame: Activation
    network: bool
    found: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongForm:
    """A form that is wrong in every frame: it has `found` instead of `expected`."""

    form: str
    subject: str
    found: str
    expected: str


Counterexample = WrongWinner | WrongActivity | WrongForm


@dataclass(frozen=True, slots=True, kw_only=True)
class EquivalenceUndecided:
    """Subjects that were neither proved nor refuted: (form, actuator), mostly.

    z3 gave up after `seconds`; if that is 0, z3 was not used. `by_structure` other obligations hold.
    """

    subjects: tuple[tuple[str, str], ...]
    seconds: float
    by_structure: int = 0


Result = EquivalenceProved | Counterexample | EquivalenceUndecided


def merge_results(
    results: Sequence[EquivalenceProved | EquivalenceUndecided],
) -> EquivalenceProved | EquivalenceUndecided:
    """Return results combined into one, which is `EquivalenceProved` if all are."""
    proved = [r for r in results if isinstance(r, EquivalenceProved)]
    undecided = [r for r in results if isinstance(r, EquivalenceUndecided)]
    by_structure = sum(r.by_structure for r in results)
    if undecided:
        subjects = tuple(dict.fromkeys(subject for r in undecided for subject in r.subjects))
        return EquivalenceUndecided(
            subjects=subjects, seconds=undecided[0].seconds, by_structure=by_structure
        )
    return EquivalenceProved(
        forms=tuple(dict.fromkeys(form for r in proved for form in r.forms)),
        by_structure=by_structure,
        by_solver=sum(r.by_solver for r in proved),
        questions=sum(r.questions for r in proved),
    )


# --- in words ------------------------------------------------------------------------------------


def frame_text(frame: Activation) -> str:
    """Return a phrase for a frame that can follow "with"."""
    active = f"{listed(frame.active)} active" if frame.active else "no module active"
    recent = [_ago(activity) for activity in frame.recent]
    return f"{active}, and {listed(recent)}" if recent else active


def _ago(recent: Recent) -> str:
    before = f"less than {duration_text(recent.max_age_ns)} ago"
    if recent.min_age_ns:
        return f"{recent.name} {duration_text(recent.min_age_ns)} ago or more, but {before}"
    return f"{recent.name} {before}"


def counterexample_text(found: Counterexample) -> str:
    """Return a sentence about what is wrong."""
    match found:
        case WrongWinner():
            says = f"the network lets {found.network or 'no module'} through"
            does = f"by priority {found.by_priority or 'no module'} commands"
            if found.by_exclusive is not None:
                does += f", by exclusive guard {listed(found.by_exclusive) or 'no module'}"
            return f"{found.form}: {found.actuator}: with {frame_text(found.frame)}, {says}; {does}"
        case WrongActivity():
            says = f"is {'' if found.network else 'not '}active in the network"
            does = f"{'' if found.found else 'not '}active in what was compiled"
            return f"{found.form}: with {frame_text(found.frame)}, `{found.name}` {says}, and {does}"
        case WrongForm():
            return f"{found.form}: {found.subject}: found {found.found}, expected {found.expected}"


def undecided_text(found: EquivalenceUndecided) -> str:
    """Return a sentence about what was not settled."""
    subjects = listed([f"{form}: {subject}" for form, subject in found.subjects])
    if found.seconds > 0:
        return (
            f"{subjects}: z3 found neither a proof nor a counterexample within {found.seconds:g} s of steps"
        )
    structure = counted(found.by_structure, "obligation")
    return f"{subjects}: not proved without z3 ({structure} proved by structure)"


def proved_text(found: EquivalenceProved) -> str:
    """Return a line about what was proved."""
    how = f"{found.by_structure} by structure, {found.by_solver} by z3"
    same = listed((*found.forms, "network"))
    return f"proved: {same} are the same ({found.obligations} obligations: {how})"
