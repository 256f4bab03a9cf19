"""The ball's angular velocity from a video of its seam. Nothing is imported here, because OpenCV is an extra."""
