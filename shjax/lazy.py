"""Names of a package that are imported when they are first used (PEP 562).

``import shjax`` costs nothing then, help and the process that reads files need no JAX.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def attach(
    package: str, names: Mapping[str, Sequence[str]], modules: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    Args:
        package: Its ``__name__``.
        names: Those to be imported, by the module of the package that has them.
        modules: Those of its modules that are names themselves.
    """
    home = {name: module for module, some in names.items() for name in some}
    listed = sorted([*home, *modules])

    def get(name: str) -> Any:
        if name not in listed:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{home.get(name, name)}")
        found = getattr(module, name) if name in home else module
        setattr(sys.modules[package], name, found)
        return found

    return get, lambda: list(listed), listed
