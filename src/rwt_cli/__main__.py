"""`python -m rwt_cli` is `rwt`."""

from rwt_cli import main

raise SystemExit(main())
