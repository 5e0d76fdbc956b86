"""The type stubs say what the compiled module has."""

import os
import subprocess
import sys
from pathlib import Path

PACKAGE = str(Path(__file__).parents[2] / "coupling" / "python")


def test_names_and_arguments_are_those_of_the_module() -> None:
    command = [sys.executable, "-m", "mypy.stubtest", "voidage._voidage"]
    env = os.environ | {"PYTHONPATH": PACKAGE, "MYPYPATH": PACKAGE}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
