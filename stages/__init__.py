"""One file per DVC stage, run as `python -m stages.NAME` from the repository's root."""

import time

# when the process of a stage began: Python imports this file before all others of the stage
STARTED = time.time()
