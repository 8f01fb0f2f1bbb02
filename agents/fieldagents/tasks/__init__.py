"""The tasks, one folder each; ``fieldagents.task`` finds them and says what each file of a folder holds."""
