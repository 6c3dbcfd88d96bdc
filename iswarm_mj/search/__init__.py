"""Many runs: sweeps, searches for genomes, trainings of policies, and journals of finished runs."""
