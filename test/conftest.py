"""Settings shared by all tests."""

from __future__ import annotations

import signal

from hypothesis import settings

# Compilation of kernels and loading of robots make first examples slow; that is no failure.
settings.register_profile("default", deadline=None)
settings.load_profile("default")

# Where the tests run in the background, they were told to ignore Ctrl-C, and so would be the commands that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
