"""The command line: ``python -m raybrook`` is the program ``raybrook``."""

import sys


def main() -> None:
    """Do what the arguments say, and end the process with the documented exit code."""
    from . import _raybrook

    sys.exit(_raybrook.run_command_line(["raybrook", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
