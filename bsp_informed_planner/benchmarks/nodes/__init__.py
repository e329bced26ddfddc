"""Benchmark of the nodes: what they cost, and what they stand."""
