"""The papers behind the tasks: what they claim, and their tables and figures with ours beside them."""
