"""Smallest and largest degree of each polynomial model; fits, designs and settings share them."""

POLYNOMIAL_DEGREES = (1, 6)
ENERGY_DEGREES = (4, 6)
