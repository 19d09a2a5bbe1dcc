"""What is measured of depth images, each with sums over frames that need no memory for them."""
