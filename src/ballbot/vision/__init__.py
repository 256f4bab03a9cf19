"""Motion measured from video: the ball's angular velocity from its seam. OpenCV is an extra: nothing is imported."""
