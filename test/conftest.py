"""Settings shared by all tests."""

from __future__ import annotations

from hypothesis import settings

# Compilation of kernels and loading of robots make first examples slow; that is no failure.
settings.register_profile("default", deadline=None)
settings.load_profile("default")
