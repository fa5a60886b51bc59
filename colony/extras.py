"""The optional extras of the distribution, and the packages that each of them installs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from colony.text.wording import listed

EXTRAS = {
    "verify": ("hypothesis", "z3"),
    "sim": ("matplotlib", "networkx", "numba", "numpy", "PIL", "yaml"),
    "vision": ("cv2", "PIL", "numpy"),
    "mujoco": ("mujoco", "numpy"),
    "drivers": ("serial",),
    "bags": ("rosbags",),
    "watch": ("starlette", "uvicorn", "websockets"),
    "foxglove": ("foxglove",),
    "native": ("cffi", "pycparser"),
    "dask": ("distributed",),
}
"""The modules that each extra installs."""


class MissingExtraError(ModuleNotFoundError):
    """A module of an extra that is not installed; the message has the extra and the command to install it."""


def installed(module: str) -> bool:
    """Return True if a module of an extra is installed."""
    return find_spec(module) is not None


def install_command(*extras: str) -> str:
    """Return the command that installs these extras."""
    return f"pip install 'colony-robotics[{','.join(extras)}]'"


def expect_extras(*extras: str) -> None:
    """Check that these extras are installed, before any work begins.

    Raises:
        MissingExtraError: names all missing extras.
    """
    missing = {extra: [m for m in EXTRAS[extra] if not installed(m)] for extra in extras}
    names = [extra for extra in extras if missing[extra]]
    if names:
        raise _missing([module for extra in names for module in missing[extra]], names)


@contextmanager
def naming_missing_extras() -> Iterator[None]:
    """Replace the error for a missing module by one that names its extra.

    Raises:
        MissingExtraError: in place of a ModuleNotFoundError for a module of an extra.
    """
    try:
        yield
    except MissingExtraError:
        raise
    except ModuleNotFoundError as problem:
        module = (problem.name or "").partition(".")[0]
        extras = [extra for extra, modules in EXTRAS.items() if module in modules]
        if not extras:
            raise
        raise _missing([module], extras[:1]) from None


def _missing(modules: list[str], extras: list[str]) -> MissingExtraError:
    subject = f"extra{'' if len(extras) == 1 else 's'} {listed(extras)}"
    return MissingExtraError(
        f"{subject} not installed (no {modules[0]}); run: {install_command(*extras)}", name=modules[0]
    )
