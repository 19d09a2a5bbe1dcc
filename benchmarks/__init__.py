"""Measurements that need more than `radcam-depth bench`."""
