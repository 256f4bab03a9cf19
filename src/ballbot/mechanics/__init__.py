"""Geometry, friction, the equations of motion, their compiled kernels and the symbolic derivation that tests them."""
