"""Tests. One thread of BLAS: it is set before anything loads numpy, and processes inherit it.

Tests run beside each other. Threads that share a product of matrices wait for each other, busily,
on cores that other tests need: a third of the work of comparisons, for nothing.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
