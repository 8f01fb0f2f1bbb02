"""The exam of the diagnosis: how often it is right about what a hidden simulation puts into the data."""
