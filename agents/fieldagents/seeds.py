"""Published episode seeds: what is tuned or trained on never meets what is tested on."""

LARGEST_SEED = 2**32 - 1
"""What every random generator underneath takes; no command and no config takes more."""

TUNING_SEEDS = range(0, 10_000)
"""Seeds that tuning and model selection may use."""

TRAINING_SEEDS = range(10_000, 1_000_000)
"""Seeds that the episodes of learning may use."""

TEST_SEEDS = range(1_000_000, 1_010_000)
"""Seeds of reported episodes: the first ``n`` of them, the same for every agent."""
