"""Models that the inference node may serve with."""

#: "bsp": exact keypoints of the decomposition, lifted to configurations, with a Gaussian tube around their chain.
MODELS = ("bsp",)
