"""`python -m radcam_depth_ros.cli`, for a checkout that is not installed."""

from radcam_depth_ros.cli import main

main()
