"""The compiler's passes in a row: text-free, from the typed program to the clients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from colony.collector import collector_at_rest
from colony.compile.clients import ClientList
from colony.compile.network import Network
from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.compile.passes.simplify import simplify
from colony.compile.suppression import SuppressionNetwork
from colony.ir.program import Program

PASSES: tuple[Callable[[Any], object], ...] = (
    elaborate,  # Program -> Network
    eliminate_inhibition,  # Network -> SuppressionNetwork     Lemma 4.1
    forward_traversal,  # SuppressionNetwork -> ClientList     definitions 4.1, 4.2, Table 4.2
    simplify,  # ClientList -> ClientList
)
"""What compilation is, in order: each takes what the one before it gives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiled:
    """A program with what each pass made of it; `traversal` are the clients before simplification."""

    program: Program
    network: Network
    suppression: SuppressionNetwork
    traversal: ClientList
    clients: ClientList


def compile_program(program: Program) -> Compiled:
    """All passes over a typed program. Near-linear in the size of its network."""
    with collector_at_rest():
        network = elaborate(program)
        suppression = eliminate_inhibition(network)
        traversal = forward_traversal(suppression)
        clients = simplify(traversal)
    return Compiled(
        program=program, network=network, suppression=suppression, traversal=traversal, clients=clients
    )


def traverse(program: Program) -> ClientList:
    """The clients of a typed program before simplification, in which time constants have places."""
    with collector_at_rest():
        return forward_traversal(eliminate_inhibition(elaborate(program)))


def compile_network(network: Network) -> ClientList:
    """The passes over a network that no program describes, such as one drawn by a property test."""
    with collector_at_rest():
        return simplify(forward_traversal(eliminate_inhibition(network)))
