"""How many threads the linear algebra of numpy and scipy takes: one, as in each of our workers."""

from __future__ import annotations

import os

VARIABLE = "OPENBLAS_NUM_THREADS"


def use_one_blas_thread() -> None:
    """Let products of matrices be done by the thread that asks for them, unless the user says else.

    Frames are done by workers beside each other, one per core. Threads that OpenBLAS adds wait for
    each other busily, on cores that other workers need: a third of all the processor time of
    `compare` on KITTI (2026-11-27), for products that are done in a millisecond.
    """
    if VARIABLE in os.environ:
        return
    from threadpoolctl import threadpool_limits

    os.environ[VARIABLE] = "1"  # scipy's, which is loaded later, and processes of ours
    threadpool_limits(1, user_api="blas")  # numpy's, which is loaded
