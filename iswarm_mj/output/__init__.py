"""Files that runs write: trajectories, results, recordings, pictures, videos, figures."""
