"""Who acts: published algorithms, learned policies, training, evaluation, command line."""
