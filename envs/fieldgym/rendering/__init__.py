"""Pictures of the tasks, drawn with pygame."""
