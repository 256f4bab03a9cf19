"""What a camera tells: the ball's angular velocity by its seam (`spin`), a body's swing (`swing`).

Nothing is imported here, for OpenCV, which some of it needs, is an extra.
"""
