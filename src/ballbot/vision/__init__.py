"""The ball's angular velocity from a video of its seam."""
