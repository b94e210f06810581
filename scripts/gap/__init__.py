"""The gap between real and twin: synthesis, observables, floor, fit, ranking, verdict. Knows no file formats."""
