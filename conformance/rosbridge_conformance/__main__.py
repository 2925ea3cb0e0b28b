"""Entry point of `python -m rosbridge_conformance`."""

from rosbridge_conformance.command import main

raise SystemExit(main())
