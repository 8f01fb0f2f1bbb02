"""Many training runs: a grid of them, or a search of hyper-parameters."""
