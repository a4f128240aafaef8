"""What softcal's speed goals are measured with. `python -m benchmarks.run` runs all and writes RESULTS.md."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does
