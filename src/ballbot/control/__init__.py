"""References, LQR, friction compensation, and the controller as one object.

The names are loaded from their files when first used, so that reading one costs no other's imports:
`ballbot.control.lqr`, `.controller`, `.references`, `.file`.
"""
