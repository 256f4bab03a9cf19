"""Weights of the LQR chosen by search over perturbed robots, for the worst tenth of them and not the mean."""
