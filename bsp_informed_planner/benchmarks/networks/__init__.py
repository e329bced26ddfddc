"""What networks are worth: their chains and samples, on scenes that no training has seen."""
