"""The physics model: symmetric energies of FEM bodies over modulus, Poisson's ratio and size."""
