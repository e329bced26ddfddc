"""The benchmark of the conservative collision bounds and their kernels."""
