"""`python studies/tied_dvc.py exp run ...`: DVC that ends when the process that started it ends, even by `kill -9`.

Standard input is a pipe from that process, and closes with it.
"""

import os
import signal
import sys
import time
from threading import Thread

GRACE = 30.0  # seconds in which DVC may end an experiment and remove its folder


def end_with_starter() -> None:
    """Interrupt DVC and its stages once standard input closes; kill those that still run after `GRACE`."""
    os.read(0, 1)
    os.killpg(0, signal.SIGINT)
    time.sleep(GRACE)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    os.setsid()  # a separate session: Ctrl-C in the terminal reaches the starting process alone
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a script's `&` makes its programs ignore the signal
    Thread(target=end_with_starter, daemon=True).start()
    from dvc.cli import main

    sys.exit(main(sys.argv[1:]))
