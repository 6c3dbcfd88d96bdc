"""Studies of many runs: evolution, the paper's experiments, and the processes that work on them."""
