"""Cases unlike those of `exam`: other records and machines, declared as a user would."""
