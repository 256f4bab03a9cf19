"""Motion measured from video: the ball's angular velocity from its seam (`spin`), a body's swing (`swing`).

Nothing
is imported here, because OpenCV is an extra.
"""
