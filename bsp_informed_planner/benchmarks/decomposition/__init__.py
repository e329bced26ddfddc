"""The benchmark of the decomposition: `benchmark.decomposition_benchmark`."""
