"""One file for each DVC stage, run as `python -m stages.NAME` from the repository's root."""

import time

# time at which the process of a stage began, since Python imports this file before the stage's
STARTED = time.time()
