"""What runs write: trajectories, results, recordings, pictures, figures."""
