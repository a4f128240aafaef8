"""The forward problem: terms, their sum, its equilibria and their sensitivities. Only here iterations run."""
