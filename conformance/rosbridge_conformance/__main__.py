"""`python -m rosbridge_conformance` runs the suite."""

from rosbridge_conformance.command import main

raise SystemExit(main())
