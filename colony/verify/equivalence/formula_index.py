"""An index of formulas, to find an earlier formula that is provably equal to a new one.

Candidates are found in two ways. Every node has a *fingerprint*: its value if inputs are random numbers
modulo a prime, a conjunction is a product, and `not a` is 1 - a; so conjunctions of the same parts have the
same fingerprint, whatever their order. It also has a *signature*: its values under about a thousand random
valuations of the inputs. z3 then proves that two candidates are equal. If a proof would take too long, the
new formula stays, which only costs speed. Replacing each formula by an equal older one keeps the next proofs
small, since their parts are already the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from random import Random

from colony.verify.equivalence.circuit import FALSE, TRUE, Circuit, HeldInput, Opaque
from colony.verify.equivalence.solver import NEAR_LIMITS, CircuitSolver, differ

CANDIDATES = 4
"""Maximum number of formulas to try per signature; a signature of more formulas is not distinctive."""

_SEED = 1994
_PRIME = 2**61 - 1


class FormulaIndex:
    """The formulas of a circuit, by fingerprint and signature. Mutable: it grows with the circuit.

    `order` lists inputs (or their negations), first those that are likely to dominate later ones: valuations
    in which only inputs from some position on are true distinguish formulas that are nearly always false.
    `rare_inputs` are further inputs, besides histories, that should mostly be false. `near_limits` are those
    of `CircuitSolver.refutes` for candidates of which only the signatures are equal.
    """

    def __init__(
        self,
        circuit: Circuit,
        solver: CircuitSolver,
        order: Sequence[int] = (),
        rare_inputs: Iterable[int] = (),
        near_limits: Sequence[int] = NEAR_LIMITS[:2],
    ) -> None:
        self.circuit = circuit
        self.solver = solver
        self.merged = 0
        self._near = near_limits
        self._random = Random(_SEED)
        self._width = 1024 if len(circuit) < 2_000 else 8192
        self._mask = (1 << self._width) - 1
        self._quarters = tuple(int("0" * i + "1" + "0" * (3 - i), 2) * (self._mask // 15) for i in range(4))
        self._order: dict[int, tuple[int, int]] = {}  # by node: position, and 1 if it is negated
        for literal in order:
            self._order.setdefault(literal >> 1, (len(self._order), literal & 1))
        self._rare = {literal >> 1 for literal in rare_inputs}
        self._rare |= {
            literal >> 1 for input_, literal in circuit.inputs.items() if not isinstance(input_, Opaque)
        }
        self._rare -= self._order.keys()
        self._signatures: list[int] = []
        self._fingerprints: list[int] = []
        self._old = len(circuit)
        self._extend()
        self._by_fingerprint: dict[int, int] = {}
        for node, fingerprint in enumerate(self._fingerprints):
            self._by_fingerprint.setdefault(min(fingerprint, (1 - fingerprint) % _PRIME), node)
        self._by_signature: dict[int, list[int]] = {}
        for node, signature in enumerate(self._signatures):
            self._by_signature.setdefault(min(signature, signature ^ self._mask), []).append(node)
        self._histories: dict[int, list[tuple[int, int]]] = {}
        for input_, literal in circuit.inputs.items():
            if isinstance(input_, HeldInput):
                self._histories.setdefault(input_.window_ns, []).append((input_.operand, literal))

    def find(self, literal: int) -> int:
        """Return an earlier literal that is proved equal, otherwise the literal itself."""
        if literal >> 1 < self._old:
            return literal
        self._extend()
        fingerprint = self._fingerprints[literal >> 1]
        likely = self._by_fingerprint.get(min(fingerprint, (1 - fingerprint) % _PRIME))
        if likely is not None:
            old = 2 * likely + ((fingerprint != self._fingerprints[likely]) ^ (literal & 1))
            if self.solver.refutes(differ(literal, old)):
                self.merged += 1
                return old
        for old in self._candidates(literal):
            if self.solver.refutes(differ(literal, old), near_limits=self._near):
                self.merged += 1
                return old
        return literal

    def _candidates(self, literal: int) -> list[int]:
        """Return the earlier literals with the same signature, or the constant; none if they are too many."""
        value = self._value(literal)
        if value in (0, self._mask):
            return [TRUE if value else FALSE]
        nodes = self._by_signature.get(min(value, value ^ self._mask), [])
        if len(nodes) > CANDIDATES:
            return []
        return [2 * node + (value != self._signatures[node]) for node in nodes]

    def recently(self, operand: int, window_ns: int) -> int:
        """Return "holds or held within a window", reusing the history of a provably equal condition."""
        if operand in (FALSE, TRUE) or window_ns <= 0:
            return operand
        history = self._history_of(operand, window_ns)
        return self.circuit.either(operand, history)

    def _history_of(self, operand: int, window_ns: int) -> int:
        histories = self._histories.setdefault(window_ns, [])
        for old, history in histories:
            if old == operand:
                return history
        self._extend()
        candidates = [(old, h) for old, h in histories if self._value(old) == self._value(operand)]
        for old, history in [(FALSE, FALSE), *candidates] if self._value(operand) == 0 else candidates:
            if self.solver.refutes(differ(operand, old)):
                self.merged += 1
                histories.append((operand, history))
                return history
        history = self.circuit.input(HeldInput(operand, window_ns))
        histories.append((operand, history))
        return history

    # --- signatures ------------------------------------------------------------------------------

    def _value(self, literal: int) -> int:
        signature = self._signatures[literal >> 1]
        return signature ^ self._mask if literal & 1 else signature

    def _extend(self) -> None:
        """Compute the missing signatures and fingerprints."""
        signatures, fingerprints, circuit = self._signatures, self._fingerprints, self.circuit
        for node in range(len(signatures), len(circuit)):
            if node and not circuit.is_input(node):
                left, right = circuit.left[node], circuit.right[node]
                signatures.append(self._value(left) & self._value(right))
                fingerprints.append(self._fingerprint(left) * self._fingerprint(right) % _PRIME)
            else:
                signatures.append(self._random_valuations(node) if node else 0)
                fingerprints.append(self._random.randrange(_PRIME) if node else 0)

    def _fingerprint(self, literal: int) -> int:
        fingerprint = self._fingerprints[literal >> 1]
        return (1 - fingerprint) % _PRIME if literal & 1 else fingerprint

    def _random_valuations(self, node: int) -> int:
        """Return random valuations of an input.

        In the i-th of n valuations only inputs from position i/n of the order on are true, except for a few
        others. In a quarter of the valuations half of these are true, in the others fewer. So for each
        position some valuations let the input at that position through.
        """
        width = self._width
        dense, sparser, sparse, quiet = self._quarters
        if node in self._order:
            position, negated = self._order[node]
            end = width * (position + 1) // len(self._order) + 1
            free = self._sparse(1) & dense | self._sparse(3) & (sparser | quiet) | self._sparse(5) & sparse
            drawn = free & ((1 << min(width, end)) - 1) | self._few(len(self._order))
            return drawn ^ self._mask if negated else drawn
        if node in self._rare:
            return self._sparse(4) & dense | self._few(len(self._rare))
        return self._random.getrandbits(width)

    def _sparse(self, halvings: int) -> int:
        """Return a random set of valuations, each with a probability of one in 2 ** halvings."""
        drawn = self._mask
        for _ in range(halvings):
            drawn &= self._random.getrandbits(self._width)
        return drawn

    def _few(self, inputs: int) -> int:
        """Return a few random valuations, so that about half of all have one of `inputs` inputs true."""
        drawn = 0
        for _ in range(max(1, self._width // (2 * inputs))):
            drawn |= 1 << self._random.randrange(self._width)
        return drawn

    # --- histories of the network itself ---------------------------------------------------------

    def first_equal(self, literals: Sequence[int]) -> list[int | None]:
        """Return, for each literal, the index of the first provably equal one; None for a false literal."""
        groups: dict[int, list[int]] = {}
        found: list[int | None] = []
        for position, literal in enumerate(literals):
            value = self._value(literal)
            if value == 0 and self.solver.refutes([(literal,)]):
                found.append(None)
                continue
            group = groups.setdefault(value, [])
            same = (o for o in group[:CANDIDATES] if self.solver.refutes(differ(literal, literals[o])))
            first = next((o for o in group if literals[o] == literal), None)
            first = next(same, position) if first is None else first
            if first == position:
                group.append(position)
            found.append(first)
        return found

    def remember(self, operand: int, window_ns: int, history: int) -> None:
        """Record that `history` is true less than the window after a frame with `operand`."""
        self._histories.setdefault(window_ns, []).append((operand, history))
