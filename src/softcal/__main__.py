"""`python -m softcal` is `softcal`."""

from softcal.cli import main

main()
