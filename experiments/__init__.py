"""Experiments: short trainings and comparisons that answer a question about accuracy."""
