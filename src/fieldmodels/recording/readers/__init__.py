"""One module a file format; each has ``read(path) -> Table`` and imports its library when it is called."""
