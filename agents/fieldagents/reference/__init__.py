"""The published algorithms and the strongest classical answers, one file a task."""
