"""The program ``voidage``, as it is installed with this package."""

import sys

from ._voidage import main


def run() -> int:
    """Run the program with the arguments of this process; returns its exit code."""
    return main(["voidage", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(run())
