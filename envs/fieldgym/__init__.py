"""The tasks as Gymnasium environments over the models."""
