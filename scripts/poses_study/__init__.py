"""One marker in all six degrees of freedom before a camera: the poses, errors beside what corners predict of them, maps."""
