"""Estimators that serve several tasks."""
