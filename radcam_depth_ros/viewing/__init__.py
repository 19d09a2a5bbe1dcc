"""Draws drives: the camera beside its depth, as a video, a folder of images or a strip."""

from radcam_depth_ros.viewing.live import view_live
from radcam_depth_ros.viewing.picture import ViewError, draw_picture
from radcam_depth_ros.viewing.recorded import RecordedDepth, find_recorded_depth
from radcam_depth_ros.viewing.view import ViewOptions, view

__all__ = ["RecordedDepth", "ViewError", "ViewOptions", "draw_picture", "find_recorded_depth", "view", "view_live"]
