"""OMPL's planners in worker processes: `process` is the side that plans, `worker` and `planners` the other one.

Imports as little as possible, since each worker does: what planning needs besides would double the time of its start.
"""
