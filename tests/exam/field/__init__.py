"""Cases unlike those of `fieldmodels.exam`: other records and machines, declared as a user would."""
