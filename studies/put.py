"""Queue the experiments {name: changes} of standard input, as `dvc exp run --queue` does with one of them."""

import json
import sys
import time

PATIENCE = 180  # seconds that a worker may hold the queue's lock, as DVC's workers wait for each other


def main() -> None:
    """Queue them in their order."""
    from dvc.exceptions import DvcException
    from dvc.lock import LockError
    from dvc.repo import Repo

    with Repo() as repo:
        for name, changes in json.load(sys.stdin).items():
            begin = time.monotonic()
            while True:
                try:
                    repo.experiments.run(queue=True, name=name, params=changes)
                    break
                except LockError:
                    if time.monotonic() - begin > PATIENCE:
                        raise
                    time.sleep(1)
                except DvcException as error:
                    sys.exit(f"ERROR: {error}")


if __name__ == "__main__":
    main()
