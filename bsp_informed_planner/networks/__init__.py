"""Networks that estimate keypoints and draw samples, their weights, and the cards that describe them.

This room needs torch. It knows scenes, not robots: states are rows of numbers.
"""
