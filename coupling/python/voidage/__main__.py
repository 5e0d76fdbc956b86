"""The program ``voidage``, as it is installed with this package."""

import signal
import sys

from ._voidage import main


def run() -> int:
    """Run the program with the arguments of this process; returns its exit code."""
    # The program listens to Ctrl-C itself: in the midst of a scheme in Python it would be an exception, and end a run
    # without its checkpoint.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return main(["voidage", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(run())
