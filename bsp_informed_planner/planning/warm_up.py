"""Compiles the kernels of this part by small problems."""

from __future__ import annotations


def warm_up() -> None:
    """Nothing yet."""
