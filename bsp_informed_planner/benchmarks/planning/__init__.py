"""The benchmark of planning: `benchmark.planning_benchmark`."""
