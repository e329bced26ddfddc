"""Settings shared by all tests."""

from __future__ import annotations

import os
import signal

from hypothesis import settings

# Compilation of kernels and loading of robots make first examples slow; that is no failure.
settings.register_profile("default", deadline=None)
# The same examples each time: what fails there fails for a change, not by chance. `make test` draws new ones.
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

# Where the tests run in the background, they were told to ignore Ctrl-C, and so would be the commands that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
