"""Published ball-balancing robots: what each source prints, what comes out of our equations, and why they differ.

One file a source. Each takes the robot's preset, switches on the source's own convention or mistake (by data: a
robot with other inertias, or a mixture of the thesis's corrections), and sets printed, reproduced and right numbers
side by side. The page needs SymPy (`pip install ballbot[symbolic]`):
`python -m campaigns.published.page`
"""
