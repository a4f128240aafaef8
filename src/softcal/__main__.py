"""`python -m softcal` is `softcal`, without modules of the present folder, which Python has put first on the path."""

import os
import sys

_FIRST, _SOURCE = sys.path[0], os.path.dirname(os.path.dirname(__file__))
if not sys.flags.safe_path and _FIRST != _SOURCE and os.path.isdir(_FIRST) and os.path.samefile(_FIRST, os.curdir):
    del sys.path[0]

from softcal.cli import main  # noqa: E402  the path first

main()
