"""Moving cameras: experiment, trajectories, exact truth, measures."""
