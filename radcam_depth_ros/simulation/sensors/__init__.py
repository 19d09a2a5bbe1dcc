"""Sensors: camera, radars, LiDAR, and where they sit on the vehicle."""
