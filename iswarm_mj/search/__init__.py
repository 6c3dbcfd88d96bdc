"""Many runs: sweeps, searches for fit genomes, trainings of policies, and the journals that keep them."""
