"""Regression with correlated noise: rows, noise model, folds, normal equations, F tests."""
