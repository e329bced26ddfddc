"""The paper's experiments with a point robot in mazes, and what they left out."""
