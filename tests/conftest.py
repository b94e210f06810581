"""One thread for BLAS: on few cores its threads wait by spinning, and take the time from what they wait for."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
