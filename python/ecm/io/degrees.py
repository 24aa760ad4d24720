"""Smallest and largest degree of each polynomial model; fits, designs and settings share them."""

POLYNOMIAL_DEGREES = (1, 6)
MOST_OF_ONE_INPUT = 9
"""Largest degree of a polynomial of a single pose column."""
ENERGY_DEGREES = (4, 6)
