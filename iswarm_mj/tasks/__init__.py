"""What a swarm is to do: the base class of tasks, cleaning and other tasks."""
