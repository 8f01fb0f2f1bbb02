"""The physics of every machine, one folder or file each: the tasks' and the benches'."""
