"""The demo robot in a process of its own, as the tests of the command line have it."""

from tests.core.cli.conftest import demo as demo
from tests.core.cli.conftest import rwt as rwt
