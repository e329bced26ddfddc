"""How torch runs in this package."""

from __future__ import annotations

import functools

import torch

#: Networks here are small: more threads cost more than they give, and take them from the planner.
INFERENCE_THREADS = 1


@functools.cache
def limit_threads(threads: int = INFERENCE_THREADS) -> None:
    """Bound the threads that torch uses in this process. Called by whatever loads or trains a network."""
    torch.set_num_threads(threads)
