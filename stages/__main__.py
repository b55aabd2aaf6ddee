"""`python -m stages` is `imocap`."""

from stages.cli import main

raise SystemExit(main())
