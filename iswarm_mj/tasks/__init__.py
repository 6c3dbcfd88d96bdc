"""What a swarm is to do: the protocol of a task, cleaning and other tasks."""
