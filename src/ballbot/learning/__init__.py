"""Controllers that are learned on the compiled loop: tasks, many robots side by side, a network, its training."""
