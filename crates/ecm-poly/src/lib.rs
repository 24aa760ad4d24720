//! Pose-to-wrench models: polynomials, principal component regression, symmetric energies, analytic stiffness
