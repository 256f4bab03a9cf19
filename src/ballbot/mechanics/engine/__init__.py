"""The compiled forms of the mechanics: many robots side by side, in one call.

compiled             Numba's options and cache, in one place
vector, elementary   tuples as vectors; sine, powers of two and their logarithm as polynomials
lanes                the work array of a block of robots; one robot's numbers out of it
smooth               RK4 while no friction changes its sign
convex               the convex step for many robots at once
slip                 steps in which wheels slip on the ball, or the ball on the floor
run                  blocks of robots through many samples
arrays               the equations at many states, for `Model`
"""
