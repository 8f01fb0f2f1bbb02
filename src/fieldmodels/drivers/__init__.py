"""What runs a machine: its windows for a diagnosis, its batch for an environment."""
