"""``python -m articulate``."""

import sys

from articulate.commands import main

sys.exit(main())
