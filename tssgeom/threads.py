"""Threads of the libraries of linear algebra."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


def single_threaded() -> AbstractContextManager[object]:
    """Let libraries of linear algebra use one thread in a `with` block.

    Threads would wait for each other where matrices are small, or where each core has its worker.
    """
    return _libraries(len(sys.modules)).limit(limits=1)


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Find the libraries, which takes 3 ms: again only where there are more modules, which may bring one."""
    return ThreadpoolController()
