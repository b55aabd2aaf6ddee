"""`python -m stages` is `imocap`."""

from imocap_core.cli import main

raise SystemExit(main())
