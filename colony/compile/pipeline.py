"""The sequence of the compiler's passes, from the typed program to the compiled program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from colony.collector import gc_paused
from colony.compile.guards import ClientList
from colony.compile.lower.lower import lower
from colony.compile.network import Network, SuppressionNetwork
from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.compile.passes.simplify import simplify
from colony.execute.compiled import Compiled, SourceFile
from colony.ir.program import Program

PASSES: tuple[Callable[[Any], Any], ...] = (
    elaborate,  # Program -> Network
    eliminate_inhibition,  # Network -> SuppressionNetwork     Lemma 4.1
    forward_traversal,  # SuppressionNetwork -> ClientList     definitions 4.1, 4.2, Table 4.2
    simplify,  # ClientList -> ClientList
)
"""The passes in order: each takes the result of the one before it. `lower` then generates the code."""


@dataclass(frozen=True, kw_only=True)
class Compilation:
    """A program with the result of each pass.

    Attributes:
        program: the program.
        network: its network.
        suppression: the network without inhibitors.
        traversal: its clients before simplification.
        clients: its clients.
        other_sources: the files of the artifact that are no behaviors: the robot's body, modules in Python.
    """

    program: Program
    network: Network
    suppression: SuppressionNetwork
    traversal: ClientList
    clients: ClientList
    other_sources: tuple[SourceFile, ...] = ()

    @cached_property
    def compiled(self) -> Compiled:
        """The compiled program, to be executed, saved and sent; lowered on first access."""
        with gc_paused():
            lowered = lower(self.program, self.clients, self.traversal)
        files = self.program.files
        texts = [
            SourceFile(kind="behavior", path=path, data=source.text.encode("utf-8", "replace"))
            for path, source in files
        ]
        root = files[-1][0] if files else ""
        return replace(lowered, sources=(*texts, *self.other_sources), root=root, site=self.program.site)


def compile_program(program: Program, other_sources: tuple[SourceFile, ...] = ()) -> Compilation:
    """Run all passes over a typed program. Near-linear in the size of its network."""
    with gc_paused():
        results: list[Any] = [program]
        for compiler_pass in PASSES:
            results.append(compiler_pass(results[-1]))
    _, network, suppression, traversal, clients = results
    return Compilation(
        program=program,
        network=network,
        suppression=suppression,
        traversal=traversal,
        clients=clients,
        other_sources=other_sources,
    )
