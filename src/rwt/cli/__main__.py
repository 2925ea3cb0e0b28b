"""`python -m rwt.cli` is `rwt`."""

from rwt.cli import main

raise SystemExit(main())
