"""Binary space partitioning of the workspace: cells, portals, keypoint candidates, and chains of keypoints.

The public names are in `decomposition`, `options`, `graph` and `merging`.
"""
