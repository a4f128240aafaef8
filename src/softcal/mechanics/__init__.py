"""The forward problem: terms, their sum, its equilibria and their sensitivities. All iterative solvers are here."""
