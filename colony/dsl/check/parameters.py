"""Parameters of functions, and inputs of modules: their types, and what can be given to them."""

from __future__ import annotations

from colony.dsl import ast
from colony.dsl.check.checker import Checker, type_hint
from colony.dsl.check.compatibility import fits, plural, with_article
from colony.dsl.check.robot import check_type
from colony.dsl.check.scope import TypedParameter
from colony.ir.types import MAX_ELEMENTS, Array, Type


def check_parameter(checker: Checker, node: ast.Parameter) -> TypedParameter | None:
    """Check the type of a parameter or input; its default is left out."""
    found = check_type(checker, node.type)
    size: int | None = None
    if node.size is not None:
        size = checker.whole(node.size, "the size of an array", 1, MAX_ELEMENTS)
        if size is None:
            return None
    if found is None:
        return None
    element, unit = found
    return TypedParameter(name=node.name.text, element=element, unit=unit, is_array=node.is_array, size=size)


def takes(parameter: TypedParameter, found: Type) -> bool:
    """Return True if a value of this type can be given to a parameter."""
    expected = parameter.type
    if expected is None:
        return isinstance(found, Array) and fits(found.element, parameter.element)
    return fits(found, expected)


def argument_hint(node: ast.Expression, parameter: TypedParameter, found: Type) -> str | None:
    """Return a hint for a value that a parameter does not take, if there is one."""
    if not parameter.is_array:
        return type_hint(node, found, parameter.element)
    return type_hint(node, found.element, parameter.element) if isinstance(found, Array) else None


def what_it_takes(parameter: TypedParameter) -> str:
    """Return the type of a parameter with its article, for messages."""
    if parameter.type is None:
        return f"an array of {plural(parameter.element)}"
    return with_article(parameter.type)
