"""`python -m conformance` runs the suite."""

from conformance.command import main

raise SystemExit(main())
