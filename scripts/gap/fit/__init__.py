"""Parameters of effects fitted to captures: residuals, robust loss, floors, normal equations, evidence without a fit."""
