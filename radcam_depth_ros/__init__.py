"""Metric depth images from one camera and its radars, for ROS 2."""

__version__ = "0.1.0"  # of package.xml, by scripts/generate_pages.py
