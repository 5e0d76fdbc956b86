"""Classes of a user's files: schemes by the name ``python:FILE[:CLASS]``."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def load(file: str) -> ModuleType:
    """The module of a file, whose folder is searched for what it imports."""
    path = Path(file)
    folder = str(path.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    known = sys.modules.get(path.stem)
    if known is not None and getattr(known, "__file__", None) == str(path):
        return known
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is no Python file: its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    if known is None:
        sys.modules[path.stem] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        if known is None:
            del sys.modules[path.stem]
        raise
    return module


def scheme_class(module: ModuleType, file: str, name: str | None) -> type:
    """The class of this name, or the only one of the file itself with a method ``step`` or ``solve``."""
    classes = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type)
        and value.__module__ == module.__name__
        and (hasattr(value, "step") or hasattr(value, "solve"))
    }
    there = ", ".join(classes) or "none"
    if name is not None:
        if name not in classes:
            raise ValueError(f"{file} has no scheme {name}: it has {there}")
        return classes[name]
    if len(classes) != 1:
        help = "name one: python:FILE:CLASS" if classes else "write a class with step(system, dt)"
        raise ValueError(f"{file} has these schemes: {there}\n  help: {help}")
    return next(iter(classes.values()))
