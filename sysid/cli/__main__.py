"""`python -m sysid.cli` is `husky-sysid`."""

from sysid.cli import main

main()
