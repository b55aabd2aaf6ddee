"""`python -m imocap` is the command line."""

from imocap_core.cli import main

raise SystemExit(main())
