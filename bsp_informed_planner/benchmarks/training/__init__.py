"""Keypoint networks of several training runs, side by side: how much hangs on the data, how much on the seed."""
