"""`python -m softcal.cli` is `softcal`."""

from softcal.cli import main

main()
