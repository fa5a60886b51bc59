"""Names that begin with `_`: they belong to their file, and imports do not bring them in."""

from __future__ import annotations

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.scope import Scope, is_private

_HINT = "a name that begins with `_` can be used only in its file"


def reject_private_name(checker: Checker, node: ast.SyntaxNode, scope: Scope, name: str) -> bool:
    """Report a name that is unknown in a scope because it belongs to another file; return True if so."""
    if not is_private(name) or (scope is checker.scope and scope.declares_private(name)):
        return False
    owner = scope.file.source.name if scope.declares_private(name) else scope.private_owners.get(name)
    if owner is None:
        return False
    checker.error("E110", node, f"`{name}` belongs to `{owner}`", _HINT)
    return True


def reject_private_member(checker: Checker, node: ast.SyntaxNode, home: Scope | None, name: str) -> bool:
    """Report a member, of a module whose text is in `home`, that belongs to another file."""
    if home is None or not is_private(name) or home.file.key == checker.scope.file.key:
        return False
    checker.error("E110", node, f"`{name}` belongs to `{home.file.source.name}`", _HINT)
    return True
