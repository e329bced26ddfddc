"""Experience: problems solved offline (Algorithm 2 of the paper), datasets of them, and training from them."""
