"""Metrics of depth images against ground truth, baselines, and the tables and curves of a report."""
