"""Which Python a solver that needs FEniCSx runs in, where the one that was started has no FEniCSx."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

MODULES = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "ufl"}
"""What an import of FEniCSx may lack."""


def explain(error: ModuleNotFoundError) -> None:
    """Adds to an error what helps, if it is FEniCSx that is missing."""
    if lacks_fenicsx(error) and not getattr(error, "__notes__", None):
        error.add_note(
            f"  help: {sys.executable} has no FEniCSx; set the variable VOIDAGE_PYTHON to a Python that has it "
            "(that of Debian's python3-dolfinx is /usr/bin/python3)"
        )


def lacks_fenicsx(error: ModuleNotFoundError) -> bool:
    """Whether it is a module of FEniCSx that was not found."""
    return (error.name or "").partition(".")[0] in MODULES


def has_fenicsx(python: str) -> bool:
    """Whether another interpreter is there and finds dolfinx."""
    find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('dolfinx') is None)"
    try:
        return subprocess.run([python, "-c", find], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def take_over(python: str, module: str, arguments: list[str]) -> NoReturn:
    """Goes on as another interpreter that runs a module of this package. Its own packages come first:
    its numpy is the one that its dolfinx fits."""
    folder = str(Path(__file__).parents[1])
    run = f"import runpy; runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(python, [python, "-c", f"import sys; sys.path.append({folder!r}); {run}", *arguments])
