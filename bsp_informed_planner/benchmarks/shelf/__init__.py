"""The paper's experiment with an arm at a shelf, and what it left out."""
